"""The command ``rescore``. Heavy modules are imported by the command that needs them."""

import sys
import warnings

from recon.errors import RescoreError
from rescore.commands import (
    evidence_study,
    experiment,
    gallery,
    ground,
    inspect_run,
    localize,
    models,
    own_data,
    reconstruct,
    stereo,
    tuning,
    uiuc,
    weight,
)
from rescore.commands.base import app

__all__ = [
    "app",
    "evidence_study",
    "experiment",
    "gallery",
    "ground",
    "inspect_run",
    "localize",
    "main",
    "models",
    "own_data",
    "reconstruct",
    "stereo",
    "tuning",
    "uiuc",
    "weight",
]


def main() -> None:
    """Run the command; an error that the user can mend is one line on standard error and exit code 1."""
    # joblib renews workers whose memory has grown; it costs nothing and needs no one's attention
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs were given")
    try:
        app()
    except RescoreError as error:
        print(f"rescore: {' '.join(str(error).split())}", file=sys.stderr)
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
