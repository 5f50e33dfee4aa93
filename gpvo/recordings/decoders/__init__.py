"""Packed events of sensors and drivers: Prophesee's EVT, libcaer's packets."""
