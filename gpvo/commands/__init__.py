"""The commands of `gpvo`."""
