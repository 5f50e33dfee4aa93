"""`gpvo` and `python -m gpvo`: signals are handled before anything that takes time is imported."""

from gpvo.commands.interruption import end_at_once, ignore_signals


def main() -> None:
    """Run the command line; see `gpvo.commands.cli.main`."""
    with end_at_once():
        from gpvo.commands.cli import main as command_line
    try:
        command_line()
    finally:
        ignore_signals()


if __name__ == "__main__":
    main()
