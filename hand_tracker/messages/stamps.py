"""Find and rewrite the stamps of recorded messages without unpacking them."""

import struct


def header_stamp(data):
    """Return where the stamp is in a message whose first field is a std_msgs/Header.

    Parameters
    ----------
    data : bytes
        The message in CDR.

    Returns
    -------
    tuple of int
    """
    return (4,)


def marker_stamps(data):
    """Return where the stamps of the markers are in a MarkerArray.

    Parameters
    ----------
    data : bytes
        The visualization_msgs/msg/MarkerArray in CDR.

    Returns
    -------
    tuple of int
        One for each marker.

    Raises
    ------
    struct.error
        If the bytes end before the message does.
    """
    number = struct.Struct(_order(data) + 'I').unpack_from

    def after(at, size=1):
        """Return the end of the string or sequence that begins at or after `at`."""
        at = at + 3 & ~3
        count, at = number(data, at)[0], at + 4
        if size == 24 and count:
            at = (at + 3 & ~7) + 4
        return at + count * size

    stamps = []
    at = 8
    for _ in range(number(data, 4)[0]):
        at = at + 3 & ~3
        stamps.append(at)
        at = after(after(at + 8))           # header, ns
        at = (at + 3 & ~3) + 12             # id, type, action
        at = (at + 3 & ~7) + 4              # doubles are aligned after the 4 bytes of preamble
        at += 56 + 24 + 16 + 8 + 1          # pose, scale, color, lifetime, frame_locked
        at = after(after(at, 24), 16)       # points, colors
        at = after(at)                      # texture_resource
        at = (at + 3 & ~3) + 8
        at = after(after(after(at)))        # texture: frame_id, format, data
        at = after(at, 8)                   # uv_coordinates
        at = after(after(at))               # text, mesh_resource
        at = after(after(at)) + 1           # mesh_file, mesh_use_embedded_materials
    return tuple(stamps)


def restamp(data, stamps, time):
    """Return a message with other stamps.

    Parameters
    ----------
    data : bytes
        The message in CDR.
    stamps : iterable of int
        Where its stamps are.
    time : int
        The new stamp [ns].

    Returns
    -------
    bytes
    """
    data = bytearray(data)
    for at in stamps:
        struct.pack_into(_order(data) + 'iI', data, at, *divmod(time, 10**9))
    return bytes(data)


def _order(data):
    return '<' if data[1] & 1 else '>'
