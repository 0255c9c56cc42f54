"""The command ``rescore``. Heavy modules are imported by the command that needs them."""

import functools
import inspect
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.models import CommandInfo

from recon.errors import RescoreError
from recon.stores import located, refuse_no_bucket
from rescore.commands import (
    detectors,
    evidence_study,
    experiment,
    gallery,
    inspect_run,
    models,
    own_data,
    reconstruct,
    results,
    stereo,
    table,
    tuning,
    uiuc,
    weight,
)
from rescore.commands.base import app
from rescore.speech import doing, heartbeat, shown, silence
from rescore.stopping import Stopped, stoppable

__all__ = [
    "app",
    "detectors",
    "evidence_study",
    "experiment",
    "gallery",
    "inspect_run",
    "main",
    "models",
    "own_data",
    "reconstruct",
    "results",
    "stereo",
    "table",
    "tuning",
    "uiuc",
    "weight",
]

PANELS = {
    "The experiment": (
        "reproduce",
        "synth",
        "learn",
        "train",
        "detect",
        "fit-evidence",
        "tune",
        "apply",
        "evaluate",
    ),
    "Looking at a run": ("report", "log", "inspect", "query"),
    "Your own data": ("doctor", "import", "convert"),
    "One picture in 3D": ("reconstruct", "popup", "learn-primitives"),
    "Studies": (
        *("sweep", "study-evidence", "study-class-model", "study-relief", "study-places", "study-weight"),
        *("study-stereo", "study-models", "study-views", "localize", "grasp", "grasp-errors", "grasp-basket"),
        *("gallery", "uiuc"),
    ),
}
"""The commands in the order in which `rescore --help` lists them."""


def _with_urls(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command, which gets the path of a store for each URL that it is given as a path."""

    @functools.wraps(command)
    def called(**options: Any) -> Any:
        return command(**{name: _located(value) for name, value in options.items()})

    return called


def _located(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return type(value)(_located(v) for v in value)
    return located(value) if isinstance(value, Path) else value


def _arrange() -> None:
    names = [name for panel in PANELS.values() for name in panel]
    panel_of = {name: panel for panel, some in PANELS.items() for name in some}
    for command in app.registered_commands:
        command.rich_help_panel = panel_of[_name(command)]
        command.help = _reflowed(inspect.getdoc(command.callback) or "")
        assert command.callback is not None
        command.callback = _with_urls(command.callback)
    app.registered_commands.sort(key=lambda command: names.index(_name(command)))


def _reflowed(text: str) -> str:
    """A docstring for the terminal: its paragraphs without the line breaks of the source."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def _name(command: CommandInfo) -> str:
    return str(command.name or getattr(command.callback, "__name__", ""))


_arrange()


def _show_version(asked: bool) -> None:
    if asked:
        from importlib import metadata  # noqa: PLC0415 (it brings the parsers of e-mail)

        print(f"rescore {metadata.version('rescore')}")
        raise typer.Exit


@app.callback()
def _before_the_command(
    context: typer.Context,
    quiet: Annotated[
        bool, typer.Option("--quiet", help="No notes and no progress; results and errors stay.")
    ] = False,
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    silence(quiet)
    context.with_resource(heartbeat())
    context.with_resource(doing(str(context.invoked_subcommand)))


_KEPT = {
    "reproduce": "finished stages and rendered frames are kept; run the command again to go on",
    "synth": "finished frames are kept; run the command again to go on",
    "apply": "parts of a table are kept; run the command again to go on",
    "detect": "parts of a table are kept; run the command again to go on",
    "localize": "what is learned and finished trials are kept; run the command again to go on",
    "grasp": "what is learned and finished trials are kept; run the command again to go on",
    "study-weight": "candidates under --keep are kept; run the command again to go on",
}
"""What of a command that was stopped is left, where something is."""


def _words(stopped: Stopped) -> str:
    """What was stopped, what was kept and how to go on, in one line."""
    at = f" at {stopped.stage}" if stopped.stage else ""
    kept = _KEPT.get(stopped.command, "no half-written file is left; run the command again")
    return f"{stopped.command or 'command'} stopped{at} ({stopped}); {kept}"


def _refuse_empty(words: list[str]) -> None:
    """Raises RescoreError where an argument is empty, which would mean this folder, or nothing at all."""
    for before, word in zip(("", *words), words, strict=False):
        if word == "":
            at = before if before.startswith("--") else "an argument"
            raise RescoreError(f"{at}: expected a value, got an empty text; set the variable it comes from")


def main() -> None:
    """Run the command; an error that the user can mend is one line on standard error and exit code 1."""
    # joblib renews workers whose memory has grown; it costs nothing and needs no one's attention
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs were given")
    try:
        with stoppable():
            _refuse_empty(sys.argv[1:])
            for word in sys.argv[1:]:
                refuse_no_bucket(word)
            app()
    except Stopped as stopped:
        print(f"rescore: {_words(stopped)}", file=sys.stderr)
        sys.exit(stopped.exit_code)
    except MemoryError:
        print("rescore: expected enough memory, got no more; use smaller files or --jobs 1", file=sys.stderr)
        sys.exit(1)
    except RescoreError as error:
        print(f"rescore: {shown(' '.join(str(error).split()))}", file=sys.stderr)
        sys.exit(1)
    except UnicodeEncodeError as error:
        print(
            f"rescore: expected names of files in UTF-8, got {error.object[-60:]!a}; rename it",
            file=sys.stderr,
        )
        sys.exit(1)
    except OSError as error:
        print(
            f"rescore: {error.filename or 'system'}: expected to read or write here, got "
            f"{error.strerror or error!r}; check the path and its permissions",
            file=sys.stderr,
        )
        sys.exit(1)


if __name__ == "__main__":
    main()
