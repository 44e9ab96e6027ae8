# SPDX-License-Identifier: MIT
"""The process that runs C under test, so that a crash or an endless loop in it is a finding and not the end of verify.

It answers on its standard output what it is asked on its standard input (`bitneat.verify.implementation` is the other end):
one byte that says what, an unsigned 32-bit count, and the data.
"""

from __future__ import annotations

import json
import resource
import signal
import struct
import sys
from typing import BinaryIO

from bitneat.verify.binary import Binary, Interface

REQUEST = struct.Struct("=cI")
_DECISION = struct.Struct("=i")
READY = b"ready\n"

RESET, STEPS, DECISIONS = b"r", b"s", b"d"


def serve(binary: Binary, time_limit: int, requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer until the other end closes."""
    interface = binary.interface
    while True:
        head = requests.read(REQUEST.size)
        if len(head) < REQUEST.size:
            return
        what, count = REQUEST.unpack(head)
        if what == RESET:
            binary.reset()
            continue
        row = 2 * (interface.num_inputs if what == STEPS else interface.num_outputs)
        data = requests.read(count * row)
        rows = [data[at : at + row] for at in range(0, count * row, row)]
        # An alarm ends a loop in C too, as the default action of its signal is to end the process.
        signal.alarm(time_limit)
        if what == STEPS:
            answer = b"".join([binary.step(inputs) for inputs in rows])
        else:
            answer = b"".join([_DECISION.pack(binary.decide(outputs)) for outputs in rows])
        signal.alarm(0)
        answers.write(answer)
        answers.flush()


def main() -> None:
    """Load what the first argument describes; say so, or why not, in a first line."""
    interface, time_limit = Interface(**json.loads(sys.argv[1])), int(sys.argv[2])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = sys.stdout.buffer
    try:
        binary = Binary(interface)
    except (AttributeError, OSError) as error:
        answers.write(f"{' '.join(str(error).split())}\n".encode())
        return
    answers.write(READY)
    answers.flush()
    serve(binary, time_limit, sys.stdin.buffer, answers)


if __name__ == "__main__":
    main()
