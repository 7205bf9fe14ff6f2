"""Output files: checked before the work, written beside their place, renamed when complete."""

import filecmp
import os
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from .core.errors import HandTrackerError

PICTURE_SUFFIXES = '.png',
YAML_SUFFIXES = '.yaml', '.yml'


class OutputError(HandTrackerError):
    """An output file cannot be written; the message names it."""


def require_suffix(path: Path, suffixes: Collection[str], expected: str = '',
                   refusal: type[HandTrackerError] = OutputError) -> None:
    """Refuse a file with another extension, in whatever case.

    Parameters
    ----------
    path : Path
    suffixes : collection of str
        Of which it must have one.
    expected : str, optional
        What the message expects; the suffixes when left out.
    refusal : type of HandTrackerError, optional
        Of the error.

    Raises
    ------
    OutputError
        Or `refusal`.
    """
    if path.suffix.lower() not in suffixes:
        raise refusal(f'{path}: unknown extension {path.suffix!r}; '
                      f'expected {expected or ", ".join(suffixes)}')


def require_folder(path: Path, refusal: type[HandTrackerError] = OutputError) -> None:
    """Refuse a file in a folder that is not there; parameters and errors as of `require_suffix`."""
    if not path.parent.is_dir():
        raise refusal(f'{path}: no folder {path.parent}; expected one to write into')


def require_writable(path: Path, suffixes: Collection[str] = ()) -> None:
    """Refuse a file that cannot be written, before the work for it begins.

    Parameters
    ----------
    path : Path
    suffixes : collection of str, optional
        Of which it must have one; any when left out.

    Raises
    ------
    OutputError
    """
    if suffixes:
        require_suffix(path, suffixes)
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise OutputError(f'{path}: cannot be written; expected a file in a folder that is there '
                          'and may be written to')


@contextmanager
def folder_beside(output: Path, refusal: type[HandTrackerError]) -> Iterator[Path]:
    """Make a folder for unfinished output beside its place, and remove it at the end.

    Parameters
    ----------
    output : Path
        Named by errors, in place of a file that nobody has asked for.
    refusal : type of HandTrackerError
        Raised where a file cannot be written.

    Yields
    ------
    Path
    """
    try:
        with TemporaryDirectory(dir=output.parent) as folder:
            yield Path(folder)
    except OSError as error:
        raise refusal(f'{output}: cannot be written ({error.strerror or error}); expected a name '
                      'in a folder that may be written to') from None


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file beside its place, and move it there when it is whole.

    Parameters
    ----------
    path : Path
        Replaced if it exists.
    write : callable
        Writes a file to a path.

    Raises
    ------
    OutputError
        If it cannot be written; what was at its place is left as it was.
    """
    with folder_beside(path, OutputError) as folder:
        unfinished = folder / path.name
        write(unfinished)
        os.replace(unfinished, path)


def write_keeping_replaced(path: Path, write: Callable[[Path], object]) -> Path | None:
    """Write a file as `write_whole` does; keep a copy of another one that is at its place.

    Parameters
    ----------
    path, write
        As of `write_whole`.

    Returns
    -------
    Path or None
        The copy of the replaced file, in place of one kept before: path.old; None where there was
        none, or one of the same content.

    Raises
    ------
    OutputError
        As by `write_whole`.
    """
    old, kept = path.with_name(f'{path.name}.old'), []

    def write_and_keep(unfinished: Path) -> None:
        write(unfinished)
        if path.exists() and not filecmp.cmp(unfinished, path, shallow=False):
            shutil.copy2(path, old)
            kept.append(old)

    write_whole(path, write_and_keep)
    return kept[0] if kept else None


def write_whole_text(path: Path, text: str) -> None:
    """Write a file of text as `write_whole` does.

    Parameters
    ----------
    path : Path
    text : str
    """
    write_whole(path, lambda unfinished: unfinished.write_text(text, encoding='utf-8'))
