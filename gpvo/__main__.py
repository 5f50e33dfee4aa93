"""`gpvo` and `python -m gpvo`: signals are handled before anything that takes time is imported."""

from gpvo.commands.interruption import signals_of_the_program


def main() -> None:
    """Run the command line; see `gpvo.commands.cli.main`."""
    with signals_of_the_program():
        from gpvo.commands.cli import main as command_line

        command_line()


if __name__ == "__main__":
    main()
