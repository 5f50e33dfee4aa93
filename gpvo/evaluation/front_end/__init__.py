"""The front end held against the truth, stage by stage."""
