"""Files of object stores and other machines, by their URL: copies here, and back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from ..core.errors import HandTrackerError


class RemoteFileError(HandTrackerError):
    """A file of another machine that cannot be read or written: which, and why."""


class Url(str):
    """Address of a file elsewhere, as s3://bucket/take.c3d."""

    @property
    def name(self) -> str:
        """File name: the last part of the URL's path."""
        return PurePosixPath(self.rstrip('/')).name


def located(text: str) -> Path | Url:
    """Return a path of this machine, or the URL of a file elsewhere."""
    return Url(text) if '://' in text else Path(text)


def matching(url: Url) -> list[Url]:
    """Return the URLs that match a URL with wildcards; a URL without them is returned itself.

    Raises
    ------
    RemoteFileError
        If there is none.
    """
    if not set('*?[') & set(url):
        return [url]
    system, path = _file_system(url)
    with _named_errors(url):
        found = [Url(system.unstrip_protocol(one)) for one in sorted(system.glob(path))]
    if not found:
        raise RemoteFileError(f'{url}: no file there has such a name')
    return found


@contextmanager
def local_copy(url: Url) -> Iterator[Path]:
    """Yield a copy of a file, or of a folder, on this machine; it is removed at the end.

    Raises
    ------
    RemoteFileError
    """
    system, path = _file_system(url)
    with TemporaryDirectory(prefix='hand_tracker-') as folder:
        copy = Path(folder, url.name)
        with _named_errors(url):
            system.get(path, str(copy), recursive=system.isdir(path))
        yield copy


def upload(local: Path, url: Url) -> None:
    """Copy a file of this machine to a URL.

    Raises
    ------
    RemoteFileError
    """
    system, path = _file_system(url)
    with _named_errors(url):
        system.makedirs(system._parent(path), exist_ok=True)
        system.put_file(str(local), path)


def exists(url: Url) -> bool:
    """Return whether a URL has a file.

    Raises
    ------
    RemoteFileError
    """
    system, path = _file_system(url)
    with _named_errors(url):
        return bool(system.exists(path))


def _file_system(url: Url) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError:
        raise RemoteFileError(f'{url}: files elsewhere need fsspec: pip install fsspec, and its '
                              'package for this store, as s3fs') from None
    try:
        system, path = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise RemoteFileError(f'{url}: {error}') from None
    return system, path


@contextmanager
def _named_errors(url: Url) -> Iterator[None]:
    # Each store has errors of its own.
    try:
        yield
    except Exception as error:
        raise RemoteFileError(f'{url}: {type(error).__name__}: {error}') from None
