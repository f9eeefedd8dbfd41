"""Reflection of a layer at an angle of incidence."""

import numpy as np

from handbench.radar.simulation.physics.reflection import interface, layer_reflection


def test_layers_at_an_angle_have_their_limits():
    """A layer of the half-space's own medium, and of no thickness, is the half-space at any angle;
    at normal incidence both polarisations agree."""
    f, epsilon = np.array([80e9]), np.array([6.4 - 8.6j])
    for cosine in (1.0, 0.7, 0.2):
        bare = interface(1.0, epsilon, cosine)
        np.testing.assert_allclose(
            layer_reflection(epsilon, epsilon, 1e-3, f, cosine), bare, atol=1e-12
        )
        np.testing.assert_allclose(
            layer_reflection(np.array([3.0]), epsilon, 0.0, f, cosine), bare, atol=1e-12
        )
    both = layer_reflection(np.array([3.0]), epsilon, 1e-4, f, 1.0)
    np.testing.assert_allclose(both, [both[0]] * 2, atol=1e-12)
