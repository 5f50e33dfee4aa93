"""Compiled kernels that all factors share: SE(3), and the local variables of a state pair."""
