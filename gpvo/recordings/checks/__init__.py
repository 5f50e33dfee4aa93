"""What can be wrong with a recording: columns, order of time, clocks, sensor size."""
