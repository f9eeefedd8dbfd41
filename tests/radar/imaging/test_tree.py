"""Skeletons and the tree of boxes: a few members carry all the others."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import qar50
from handbench.radar.imaging.cpu.adjoint import to_parent
from handbench.radar.imaging.cpu.forward import planes, to_child
from handbench.radar.imaging.skeleton import band_kernel, skeleton
from handbench.radar.imaging.tree import Box, Family, child_node, clusters, root_node, split
from tests.radar.samples import noise
from tests.strategies import examples

TONES_HZ = np.linspace(72e9, 82e9, 32)


@examples(30)
@given(n=st.integers(1, 40), rank=st.integers(1, 10), seed=st.integers(0, 2**31))
def test_a_skeleton_carries_every_member_of_a_low_rank_family(n, rank, seed):
    family = np.random.default_rng(seed).standard_normal((rank, n))
    family /= np.linalg.norm(family, axis=0)
    index, weights = skeleton(family.T @ family, 1e-6)
    assert len(index) <= min(n, rank)
    # The Gram matrix squares the condition: 1e-16 there is 1e-8 here, times what the weights
    # amplify.
    assert np.abs(family[:, index] @ weights - family).max() < 1e-5 * (1 + np.abs(weights).max())


@examples(20)
@given(half_band=st.floats(0.0, 0.4), exponent=st.floats(-5.0, -2.0), place=st.floats(-1.0, 1.0))
def test_a_band_skeleton_carries_every_wave_of_its_band(half_band, exponent, place):
    tolerance, wavenumber = 10.0**exponent, 2 * np.pi * TONES_HZ[:, None] / 299_792_458.0
    index, weights = skeleton(band_kernel(wavenumber, wavenumber, np.array([half_band])), tolerance)
    wave = np.exp(1j * place * half_band * wavenumber[:, 0])
    error = np.abs(wave[index] @ weights - wave)
    # J₀ bounds the mean over the band; a single wave at its edge may err five times more (measured:
    # two to three).
    assert np.sqrt(np.mean(error**2)) < 5 * tolerance


@examples(10)
@given(seed=st.integers(0, 2**31), whole=st.booleans())
def test_ascending_is_the_adjoint_of_descending(seed, whole):
    box = Box(np.array([0, 0, 0.25]), np.array([0.1, 0.1, 0.3]))
    above = child_node(root_node(TONES_HZ, qar50()), box, Family(1e-3, False))
    node = child_node(
        above, split(above.box, np.array([3, 3, 2]))[4], Family(1e-3, False, whole=whole)
    )
    step = (above.turns_per_m, *node.shifts_m, node.tone_weights, *node.leg_weights)
    parent = planes(
        noise((len(above.turns_per_m), *(len(leg.length_m) for leg in above.legs)), seed)
    )
    child = planes(
        noise((len(node.turns_per_m), *(len(leg.length_m) for leg in node.legs)), seed + 1)
    )
    down, up = to_child(parent, *step), to_parent(child, *step)
    left, right = np.vdot(down.astype(float), child), np.vdot(parent.astype(float), up)
    assert abs(left - right) < 1e-5 * np.linalg.norm(down) * np.linalg.norm(child)  # float32 sums


def test_small_boxes_need_few_tones_and_antennas():
    # What the paper's arithmetic promises for 22 mm: 7 to 10 tones and about 20 of 94 antennas a
    # leg at 1e-3.
    box = Box(np.array([0, 0, 0.28]), np.array([0.022, 0.022, 0.302]))
    root = child_node(root_node(TONES_HZ, qar50()), box, Family(1e-3, False))
    assert len(root.turns_per_m) <= 10
    assert all(len(leg.length_m) <= 25 for leg in root.legs)


@examples(20)
@given(
    n=st.integers(1, 50), size_m=st.sampled_from([1e-3, 1.0, 1e3, 1e6]), seed=st.integers(0, 2**31)
)
def test_clusters_hold_every_point_once_and_none_far_from_the_others(n, size_m, seed):
    points = np.random.default_rng(seed).uniform(-size_m, size_m, (n, 3))
    near = clusters(points, TONES_HZ)
    assert np.array_equal(np.sort(np.concatenate(near)), np.arange(n))
    assert all(np.ptp(points[part], axis=0).max() < 1.9e6 for part in near)
    assert max(np.prod(1 + np.ptp(points[part], axis=0) / 1.828e-3) for part in near) < 1.001e9
