"""Measurements become states: the factor graph and its solvers, section III-C.1 of the paper."""
