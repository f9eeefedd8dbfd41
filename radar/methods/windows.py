"""Sums over the window around each pixel, as compiled code."""

from handbench.support.compiled import FAST, njit


@njit(**FAST)
def window_sums(padded, rows, columns, size_px, along_x, sums):  # type: ignore[no-untyped-def]
    """Add up maps [k, ny, nx] over the window of size_px × size_px around each of the pixels in
    rows [n] and columns [n], to sums [k, n]. Each window is summed by itself, since a running sum
    would carry the rounding errors of strong pixels to weak ones.

    padded [k, ny + size_px - 1, nx + size_px - 1]: the maps amid zeros; along_x [ny + size_px - 1,
    nx]: memory.
    """
    for k in range(len(padded)):
        for y in range(along_x.shape[0]):
            for x in range(along_x.shape[1]):
                along_x[y, x] = padded[k, y, x]
            for shift in range(1, size_px):
                for x in range(along_x.shape[1]):
                    along_x[y, x] += padded[k, y, x + shift]
        for i in range(len(rows)):
            for y in range(rows[i], rows[i] + size_px):
                sums[k, i] += along_x[y, columns[i]]
