"""Poses of estimates and ground truths: where they are found and how they are read."""
