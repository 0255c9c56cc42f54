"""Rescorers that come with the package, a file a class, written by ``reports.publishing.defaults``."""

from importlib.resources import files
from importlib.resources.abc import Traversable

from recon.errors import RescoreError

FOLDER: Traversable = files(__name__)
"""The folder of the files; a zip archive has one too."""
SUFFIX = ".rescorer.json.gz"
"""End of their names, after the class; ``rescore.library.bundles`` reads and writes what they hold."""


def default_rescorer_file(class_name: str) -> Traversable:
    """The file of the rescorer that comes with the package for a class.

    Raises:
        RescoreError: none comes with it for this class.
    """
    file = FOLDER / f"{class_name}{SUFFIX}"
    if not file.is_file():
        known = sorted(f.name.removesuffix(SUFFIX) for f in FOLDER.iterdir() if f.name.endswith(SUFFIX))
        raise RescoreError(
            f"class {class_name!r}: expected a rescorer that comes with the package, found "
            f"{', '.join(known) or 'none'}; give --model, which `rescore learn --class {class_name} --out "
            f"{class_name}.json` makes (to rescore also --w or --tuned, past eq. 6 --registration and "
            "--evidence-model, in Python Rescorer.from_run or Rescorer.from_file)"
        )
    return file
