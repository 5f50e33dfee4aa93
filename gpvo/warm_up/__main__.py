"""What the second process does: python -m gpvo.warm_up."""

import gc

from gpvo.config import Configuration
from gpvo.warm_up.known_points import estimate_from_points

if __name__ == "__main__":
    gc.disable()  # the compiler keeps what it makes: looking for garbage took a tenth of the time
    estimate_from_points(Configuration())
