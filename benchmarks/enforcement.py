"""Measure what SROS 2 costs: round trips as in round_trip, open and enforced, in turns.

    python -m benchmarks.enforcement [--rates 120 480] [--seconds 5] [--json OUT]

Both trackers run at once, with the same middleware. It needs sros2 and a Fast DDS with its security
plug-ins (docs/security.md).
"""

import argparse
import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import (
    add_json_option,
    add_timing_options,
    end,
    environ,
    environment,
    write_rows,
)
from benchmarks.round_trip import HEADING, LINE, Driver, isolate, measure, messages

SIDE = 'right'
OPEN, ENFORCED = 'open', 'enforced'


class Drivers:
    """A driver for the open tracker and one for the enforced, measured as one.

    Parameters
    ----------
    drivers : dict of str to Driver
        By the namespace of the tracker.
    """

    def __init__(self, drivers):
        self._drivers = drivers

    def measure(self, names, *more):
        """Measure the one tracker of these names."""
        name, = names
        return self._drivers[name].measure(names, *more)


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_timing_options(parser, [120., 480., 960.])
    add_json_option(parser)
    options = parser.parse_args()

    isolate()
    import rclpy

    from security.policies import ENCLAVES
    from security.trials import DRIVER, UNSECURED, enforced, make_keystore
    print(environment())
    rows = []
    with TemporaryDirectory() as folder, ExitStack() as stack:
        keystore = make_keystore(folder, f'/{ENFORCED}_{SIDE}')
        drivers, processes = {}, {}
        for node in OPEN, ENFORCED:
            def security(enclave, secured=node == ENFORCED):
                return enforced(keystore, enclave) if secured else UNSECURED

            name = f'{node}_{SIDE}'
            processes[name] = process = stack.enter_context(subprocess.Popen(
                [sys.executable, '-m', 'hand_tracker.nodes.tracker_node', '--ros-args',
                 '-r', f'__ns:=/{name}', '-p', 'auto_size:=false'],
                stderr=subprocess.DEVNULL, env=environ(**security(f'{ENCLAVES}/tracker'))))
            stack.callback(end, process)
            os.environ.update(security(DRIVER))
            context = rclpy.Context()
            rclpy.init(context=context)
            drivers[name] = Driver([name], context=context, node=f'{node}_driver')
        frames = {rate: messages((SIDE,), rate) for rate in options.rates}
        for name, driver in drivers.items():
            if driver.wait_for(name, processes[name], frames[options.rates[0]]) is None:
                raise SystemExit(f'{name} does not answer')
        print(HEADING)
        for rate in options.rates:
            measured, _ = measure(Drivers(drivers), processes, (OPEN, ENFORCED), [frames[rate]],
                                  rate, (SIDE,), options.seconds)
            rows += measured
            for row in measured:
                print(LINE.format(**row))
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
