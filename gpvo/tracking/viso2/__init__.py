"""Features matched by descriptors around the quad, after viso2."""
