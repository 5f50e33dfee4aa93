"""The continuous trajectory, section III-C.2 of the paper, and poses in files."""
