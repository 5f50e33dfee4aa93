"""Factors of landmarks that are eliminated: many measurements, no landmark in the graph."""
