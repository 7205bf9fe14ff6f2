"""A simulated Qualisys Track Manager: the real-time protocol over TCP, as far as a client asks."""

import asyncio
import os
import struct
from threading import Event, Thread

import numpy as np

QTM_ERROR, QTM_COMMAND, QTM_XML, QTM_DATA = range(4)
COMPONENTS = {'3d': 1, '3dnolabels': 2, '3dres': 9, '3dnolabelsres': 10}


def packet(kind, data):
    return struct.pack('<II', 8 + len(data), kind) + data


def data_packet(number, microseconds, components):
    """Return a frame.

    Parameters
    ----------
    components : dict of str to array_like (n, 3)
        Positions by the component's name [mm].
    """
    parts = b''
    for name, rows in components.items():
        body = b''.join(
            np.asarray(at, '<f4').tobytes() + (struct.pack('<I', 70 + row) if 'nolabels' in name
                                               else b'') + (struct.pack('<f', .5) if
                                                            name.endswith('res') else b'')
            for row, at in enumerate(rows))
        body = struct.pack('<Ihh', len(rows), 0, 0) + body
        parts += struct.pack('<II', 8 + len(body), COMPONENTS[name]) + body
    return packet(QTM_DATA, struct.pack('<qII', microseconds, number, len(components)) + parts)


def parameters(labels, up='+Z'):
    """Return the XML of the 3D settings, as QTM 2024 has it."""
    return (f'<QTM_Parameters_Ver_1.25><The_3D><AxisUpwards>{up}</AxisUpwards><Labels>'
            f'{len(labels)}</Labels>' + ''.join(
                f'<Label><Name>{label}</Name><RGBColor>65280</RGBColor></Label>'
                for label in labels) + '</The_3D></QTM_Parameters_Ver_1.25>\0').encode()


def parameters_packet(labels, up='+Z'):
    return packet(QTM_XML, parameters(labels, up))


class QtmServer:
    """QTM on 127.0.0.1: answers commands, and sends data to all who stream.

    Parameters
    ----------
    labels : sequence of str
    port : int, optional
        Any that is free when left out.
    up : str, optional
        Its upward axis.
    """

    def __init__(self, labels, port=0, up='+Z'):
        self.parameters, self.port = parameters_packet(labels, up), port
        self.commands = []
        self.streams = []
        self._ready = Event()
        self._thread = Thread(target=lambda: asyncio.run(self._run()), daemon=True)

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(60.)
        return self

    def __exit__(self, *error):
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def send(self, data):
        """Send bytes to all who stream."""
        def write():
            for stream in self.streams:
                stream.write(data)
        self._loop.call_soon_threadsafe(write)

    def send_at_once(self, data):
        """Send bytes to all who stream, from the caller's thread; forget those who have gone."""
        for stream in self.streams[:]:
            try:
                os.write(stream.get_extra_info('socket').fileno(), data)
            except OSError:
                self.streams.remove(stream)

    def hang_up(self):
        """End all connections."""
        def close():
            for stream in self.streams:
                stream.close()
            self.streams.clear()
        self._loop.call_soon_threadsafe(close)

    async def _run(self):
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        server = await asyncio.start_server(self._serve, '127.0.0.1', self.port)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        await self._ended.wait()
        server.close()
        for stream in self.streams:
            stream.close()

    async def _serve(self, reader, writer):
        writer.write(packet(QTM_COMMAND, b'QTM RT Interface connected\0'))
        try:
            while True:
                size, _ = struct.unpack('<II', await reader.readexactly(8))
                command = (await reader.readexactly(size - 8)).rstrip(b'\0').decode()
                self.commands.append(command)
                name = command.split()[0].lower()
                if name == 'version':
                    writer.write(packet(QTM_COMMAND, b'Version set to 1.25\0'))
                elif name == 'getparameters':
                    writer.write(self.parameters)
                elif name == 'streamframes':
                    self.streams.append(writer)
                else:
                    writer.write(packet(QTM_ERROR, b'Parse error\0'))
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
