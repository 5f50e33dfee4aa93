"""What each command of `gpvo` does."""
