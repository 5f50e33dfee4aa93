"""Clusters become tracklets, landmarks measured at times of their own, section III-A.2."""
