"""What the second process does: python -m gpvo.warm_up."""

from gpvo.config import Configuration
from gpvo.warm_up.known_points import estimate_from_points

if __name__ == "__main__":
    estimate_from_points(Configuration())
