"""Outliers are rejected by one constant velocity, section III-B of the paper."""
