"""Films of sequences, and the frames of a result folder of which they are made."""

import io
from dataclasses import replace

import numpy as np
from PIL import Image

from handbench.bench.results.maps import frames_path, read_frames, write_frames
from handbench.reports.figures.depth_maps import film
from handbench.support.files import write_npz
from tests.golden_files import RESULT
from tests.refusals import refuse

# of a square at 0.3 m; its left half moves at ∓0.2 m/s, in turn, and its right half rests
FRAMES = read_frames(RESULT, "F", "3fsk")


def test_a_film_has_every_frame_of_a_short_sequence_in_fixed_colours():
    content = film(FRAMES, "hand")
    assert len(content) < 200_000
    pictures = []
    with Image.open(io.BytesIO(content)) as gif:
        for number in range(gif.n_frames):
            gif.seek(number)
            pictures.append(np.asarray(gif.convert("RGB"), int)[60:])  # below their titles
    first, second, third = pictures
    np.testing.assert_array_equal(first, third)
    red, _, blue = np.moveaxis(second - first, -1, 0)
    assert ((red > 50) & (blue < -50)).any()  # from blue, towards the array, to red


def test_frames_are_kept_cut_to_the_target_and_wrong_ones_are_refused(tmp_path):
    z_m = FRAMES.z_m.copy()
    z_m[:, 0] = z_m[:, :, 0] = np.nan
    write_frames(tmp_path, "hand", "3fsk", replace(FRAMES, z_m=z_m))
    kept = read_frames(tmp_path, "hand", "3fsk")
    np.testing.assert_array_equal(kept.z_m, FRAMES.z_m[:, 1:, 1:])
    np.testing.assert_array_equal(kept.x_m, FRAMES.x_m[1:])
    assert read_frames(tmp_path, "hand", "2fsk") is None
    path = frames_path(tmp_path, "hand", "3fsk")
    write_npz(path, **vars(kept) | {"velocity_m_s": kept.velocity_m_s[:1]})
    refuse(lambda: read_frames(tmp_path, "hand", "3fsk"), path.name, "velocity_m_s")
