"""Search for the files of estimates and ground truths, and reading of their poses."""
