"""Comparison of every stage of the front end with the truth."""
