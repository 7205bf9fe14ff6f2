"""Interface of a source of frames for the viewer."""

from collections.abc import Callable, Collection
from typing import Any, Protocol

from ..core.model.hand import Hand
from ..core.tracker import HandState


class FrameSource(Protocol):
    """Source of tracked frames: a recording or a running tracker.

    Attributes
    ----------
    hand : Hand
        May be replaced by another of the same side.
    constraints : frozenset of str
        Active ones of `CONSTRAINTS`.
    playhead : object or None
        With `Playhead`'s methods; None if playback cannot be controlled.
    beside : FrameSource or None
        Of the other hand, shown beside this one; it is prepared and constrained with this one.
    """

    hand: Hand
    constraints: frozenset[str]

    @property
    def playhead(self) -> Any:
        """What controls playback."""

    @property
    def beside(self) -> 'FrameSource | None':
        """The other hand's source."""

    def prepare(self, say: Callable[[str], None]) -> None:
        """Wait until there is a hand to show; report through `say` what is waited for."""

    def set_demand(self, looked_at: bool, compared: bool) -> None:
        """Set whether a browser is connected, and whether it shows the comparison."""

    def constrain(self, constraints: Collection[str]) -> None:
        """Set the active constraints."""

    def state(self) -> HandState | None:
        """Return the current hand, or None."""

    def bare_state(self) -> HandState | None:
        """Return the current hand tracked without constraints, or None."""

    def numbers(self, state: HandState) -> dict[str, str]:
        """Return measured values as texts, by name."""

    def calibration(self) -> tuple[str, dict[str, float]] | None:
        """Return a calibration's prompt and the share of each movement; None if none runs."""
