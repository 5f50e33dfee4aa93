"""What there is to see: event images with tracks, the path, its uncertainty and velocities."""
