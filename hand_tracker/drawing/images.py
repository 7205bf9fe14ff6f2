"""Figures as images, counted in picture elements, and images as an animation."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

DPI = 100    # what matplotlib counts in inches is here counted in picture elements
SAMPLES = 5  # images, in time, whose colours make a palette


def blank(width, height, **more):
    """Return a figure of so many picture elements; see `matplotlib.figure.Figure` for the rest."""
    return Figure(figsize=(width / DPI, height / DPI), dpi=DPI, **more)


def place(figure, image, left, top):
    """Put an image onto a figure as it is.

    Parameters
    ----------
    figure : Figure
    image : ndarray of uint8, shape (height, width, 3 or 4)
    left, top : float
        Of its upper left corner [picture elements].
    """
    figure.figimage(image, left, figure.bbox.height - top - len(image), origin='upper')


def write(figure, x, y, text, size, colour, **more):
    """Write onto a figure, middle of the text at picture elements from the upper left corner.

    Parameters
    ----------
    figure : Figure
    x, y, size : float
        [picture elements]
    text : str
    colour : str
    **more
        For `matplotlib.text.Text`.
    """
    figure.text(x / figure.bbox.width, 1. - y / figure.bbox.height, text, color=colour,
                fontsize=72. * size / figure.dpi, **{'ha': 'center', 'va': 'center', **more})


def drawn(figure):
    """Return a figure as an image: red, green, blue and opacity."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.array(canvas.buffer_rgba()))


def save_gif(path, images, rate, colours, swatches, tolerance=0):
    """Write an animation with one palette, so that nothing flickers.

    Parameters
    ----------
    path : path-like
    images : sequence of Image
        Without opacity.
    rate : float
        [Hz], of which the format keeps hundredths of a second.
    colours : int
        Of the palette, 256 at most.
    swatches : sequence of colour
        That have their place in it, however rare they are.
    tolerance : int
        Shades of 256 that what is shown may be off and stay where it is brightest, and less
        where it is dark: the eye sees ratios. It makes the file smaller.
    """
    width, height = images[0].size
    several = images[::-(-len(images) // SAMPLES)]
    sample = Image.new('RGB', (width, (len(several) + 1) * height))
    for i, image in enumerate(several):
        sample.paste(image, (0, i * height))
    for i, colour in enumerate(swatches):
        sample.paste(colour, (i * width // len(swatches), len(several) * height,
                              (i + 1) * width // len(swatches), sample.height))
    palette = sample.quantize(colours)
    first, *others = _indexed(images, palette, tolerance)
    first.save(path, save_all=True, append_images=others, loop=0, duration=round(1000. / rate))


def _indexed(images, palette, tolerance):
    """Yield images in the colours of a palette; where little changes, what was shown stays."""
    shown = None
    for image in images:
        new = image.quantize(palette=palette, dither=Image.Dither.NONE)
        if shown is not None and tolerance:
            off = np.abs(np.subtract(image, shown.convert('RGB'), dtype=int)).max(axis=2)
            new.paste(shown, mask=Image.fromarray(off <= tolerance / 255. * np.max(image, axis=2)))
        yield new
        shown = new
