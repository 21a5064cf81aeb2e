#!/usr/bin/python3
"""What canmatrix (Debian: python3-canmatrix) makes of frames by a .dbc: the peer of dbc_peer_test.cpp.

    dbc_peer.py FILE.dbc FRAMES OUT

FRAMES has a line "ID DATA" per frame, in hex, bit 31 of the id for 29 bits. OUT has a line "FRAME SIGNAL RAW VALUE" per
signal that is in it, where FRAME counts from 0; RAW is a whole number, or a float in hex.
"""

import sys

import canmatrix
import canmatrix.formats

EXTENDED = 1 << 31


def main():
    dbc, frames, out = sys.argv[1:]
    (matrix,) = canmatrix.formats.loadp(dbc).values()
    known = {f.arbitration_id.id | (EXTENDED if f.arbitration_id.extended else 0): f for f in matrix.frames}
    with open(frames, encoding="ascii") as lines, open(out, "w", encoding="ascii") as said:
        for number, line in enumerate(lines):
            identifier, data = line.split()
            for name, signal in known[int(identifier, 16)].decode(bytearray.fromhex(data)).items():
                raw = signal.raw_value
                raw = raw.hex() if isinstance(raw, float) else raw
                print(number, name, raw, float(signal.phys_value).hex(), file=said)


main()
