"""Writers of recordings and of the calibration beside them."""
