"""Matplotlib figures measured in pixels, written whole, and animated GIFs with one palette."""

from collections.abc import Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ..output_files import write_whole

PIXELS_PER_INCH = 100
PALETTE_FRAMES = 5  # frames, evenly spaced in time, from which the palette is computed


def spread_rows(count: int, shown: int) -> np.ndarray:
    """Return which of `count` images to show: the middles of equal parts, none of them twice."""
    return np.unique(((np.arange(shown) + .5) / shown * count).astype(int))


def blank_figure(width: float, height: float, **options: Any) -> Figure:
    """Return an empty figure of a size in pixels; `options` go to `matplotlib.figure.Figure`."""
    return Figure(figsize=(width / PIXELS_PER_INCH, height / PIXELS_PER_INCH),
                  dpi=PIXELS_PER_INCH, **options)


def write_figure(path: str | PathLike[str], figure: Figure) -> None:
    """Write a figure as a picture, whole or not at all."""
    # Without the version of matplotlib: equal numbers give equal files.
    write_whole(Path(path), lambda unfinished: figure.savefig(
        unfinished, metadata={'Software': None}))


def place_image(figure: Figure, image: np.ndarray, left: float, top: float) -> None:
    """Put an image onto a figure, one pixel of it on one of the figure.

    Parameters
    ----------
    figure : Figure
    image : ndarray of uint8, shape (height, width, 3 or 4)
    left, top : float
        Its upper left corner [px].
    """
    below = figure.bbox.height - top - len(image)
    figure.figimage(image, left, below, origin='upper')


def write_text(figure: Figure, x: float, y: float, text: str, size: float, colour: str,
               **options: Any) -> None:
    """Write text onto a figure.

    Parameters
    ----------
    figure : Figure
    x, y : float
        Middle of the text, from the figure's upper left corner [px].
    text : str
    size : float
        Of the font [px].
    colour : str
    **options
        For `matplotlib.text.Text`.
    """
    figure.text(x / figure.bbox.width, 1. - y / figure.bbox.height, text, color=colour,
                fontsize=72. * size / figure.dpi, **{'ha': 'center', 'va': 'center', **options})


def figure_image(figure: Figure) -> Image.Image:
    """Return a figure drawn as an RGBA image."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.array(canvas.buffer_rgba()))


class AnimatedFigure:
    """Figure of which few artists change: all others, such as text, are drawn once.

    Parameters
    ----------
    figure : Figure
    changing : sequence of Artist
        Drawn over the others, in this order.
    """

    def __init__(self, figure: Figure, changing: Sequence[Artist]) -> None:
        for artist in changing:
            artist.set_animated(True)
        self._changing = changing
        self._canvas = FigureCanvasAgg(figure)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(figure.bbox)

    def image(self) -> Image.Image:
        """Return the figure as it is now, as an RGBA image."""
        self._canvas.restore_region(self._still)
        for artist in self._changing:
            self._canvas.figure.draw_artist(artist)
        return Image.fromarray(np.array(self._canvas.buffer_rgba()))


def save_gif(path: str | PathLike[str], images: Sequence[Image.Image], rate: float, colours: int,
             swatches: Sequence[str], tolerance: int = 0) -> None:
    """Write an animated GIF with one palette for all frames, so that nothing flickers.

    Parameters
    ----------
    path : path-like
    images : sequence of Image
        RGB.
    rate : float
        [Hz]; the format stores periods in hundredths of a second.
    colours : int
        Size of the palette, at most 256.
    swatches : sequence of str
        Colours that get an entry in the palette, however rare they are.
    tolerance : int
        Difference, of 255, up to which a pixel of full brightness keeps its previous colour;
        proportionally less where it is darker. Makes the file smaller.
    """
    width, height = images[0].size
    sampled = images[::-(-len(images) // PALETTE_FRAMES)]
    sample = Image.new('RGB', (width, (len(sampled) + 1) * height))
    for i, image in enumerate(sampled):
        sample.paste(image, (0, i * height))
    for i, colour in enumerate(swatches):
        sample.paste(colour, (i * width // len(swatches), len(sampled) * height,
                              (i + 1) * width // len(swatches), sample.height))
    palette = sample.quantize(colours)
    first, *others = _quantized(images, palette, tolerance)
    write_whole(Path(path), lambda unfinished: first.save(
        unfinished, save_all=True, append_images=others, loop=0, duration=round(1000. / rate)))


def _quantized(images: Sequence[Image.Image], palette: Image.Image,
               tolerance: int) -> Iterator[Image.Image]:
    """Yield images in the colours of a palette, with small changes suppressed."""
    shown: Image.Image | None = None
    for image in images:
        new = image.quantize(palette=palette, dither=Image.NONE)
        if shown is not None and tolerance:
            wanted = np.asarray(image, dtype=int)
            change = np.abs(wanted - np.asarray(shown.convert('RGB'))).max(axis=2)
            allowed = tolerance / 255. * wanted.max(axis=2)
            new.paste(shown, mask=Image.fromarray(change <= allowed))
        yield new
        shown = new
