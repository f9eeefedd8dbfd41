"""Raw captures of TI's radars, written number by number as SWRA581B lists them."""

import struct


def stream(samples, receivers, lanes=2, order="IQ", real=False):
    """Return what a DCA1000 writes of samples [frame, loop, chirp, receiver 0 to 3, sample]: one
    16-bit number after the other."""
    out = []
    for chirp in samples.reshape(-1, *samples.shape[-2:]):
        i_of, q_of = chirp.real.astype(int).tolist(), chirp.imag.astype(int).tolist()
        if lanes == 4:
            for n in range(samples.shape[-1]):
                i = [i_of[rx][n] if rx in receivers else 0 for rx in range(4)]
                q = [q_of[rx][n] if rx in receivers else 0 for rx in range(4)]
                out += i if real else i + q if order == "IQ" else q + i
        else:
            for rx in receivers:
                for n in range(0, samples.shape[-1], 2):
                    i, q = i_of[rx][n : n + 2], q_of[rx][n : n + 2]
                    out += i if real else i + q if order == "IQ" else q + i
    return struct.pack(f"<{len(out)}h", *out)
