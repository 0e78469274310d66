"""`python -m maquette` and the command `maquette`."""

import signal


def start() -> None:
    """Run the command line. Ctrl-C ends the process without a traceback while it is loaded."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # otherwise it is ignored, as in a background job
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .cli.process import supervisor

    supervisor.supervise()
    from .cli.main import main

    signal.signal(signal.SIGINT, before)
    main()


if __name__ == "__main__":
    start()
