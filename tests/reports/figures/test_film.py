"""Films of sequences, and the frames of a result folder of which they are made."""

import io

import numpy as np
import pytest
from PIL import Image

from handbench.bench.results.maps import Frames, frames_path, read_frames, write_frames
from handbench.reports.figures.film import film
from handbench.support.errors import HandbenchError
from handbench.support.files import write_npz

X_M = Y_M = np.linspace(-0.05, 0.05, 11)


def sequence(count) -> Frames:
    """A square at 0.3 m; its left half moves at ∓0.2 m/s, in turn, and its right half rests."""
    z_m = np.full((count, 11, 11), np.nan, np.float32)
    z_m[:, 2:9, 2:9] = 0.3
    velocity = np.where(X_M < 0, -0.2, 0.0) * (-1.0) ** np.arange(count)[:, None, None]
    times_s = 0.005 * np.arange(count)
    return Frames(X_M, Y_M, z_m, (velocity + 0 * z_m).astype(np.float32), times_s)


def test_a_film_has_every_frame_of_a_short_sequence_in_fixed_colours():
    content = film(sequence(3), "hand")
    assert len(content) < 200_000
    with Image.open(io.BytesIO(content)) as found:
        pictures = []
        for n in range(found.n_frames):
            found.seek(n)
            pictures.append(np.asarray(found.convert("RGB"), int))
    assert len(pictures) == 3
    # frames 0 and 2 differ in their titles only, frame 1 in its velocities, too
    below = slice(60, None)
    assert np.array_equal(pictures[0][below], pictures[2][below])
    red, _, blue = np.moveaxis(pictures[1][below] - pictures[0][below], -1, 0)
    assert ((red > 50) & (blue < -50)).any()  # from blue, towards the array, to red


def test_frames_are_kept_cut_to_the_target_and_wrong_ones_are_refused(tmp_path):
    write_frames(tmp_path, "hand", "3fsk-doppler", sequence(2))
    kept = read_frames(tmp_path, "hand", "3fsk-doppler")
    assert kept.z_m.shape == (2, 7, 7) and np.array_equal(kept.x_m, X_M[2:9])
    assert read_frames(tmp_path, "hand", "3fsk") is None
    path = frames_path(tmp_path, "hand", "3fsk-doppler")
    write_npz(path, **vars(kept) | {"velocity_m_s": kept.velocity_m_s[:1]})
    with pytest.raises(HandbenchError, match="velocity_m_s"):
        read_frames(tmp_path, "hand", "3fsk-doppler")
