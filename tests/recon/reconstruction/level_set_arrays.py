"""The steps of a level set in whole arrays, as the formulas read: the compiled steps are held to it."""

import numpy as np

from recon.arrays import Float32Array
from recon.reconstruction.segment import SegmentConfig


def evolved_in_arrays(
    phi: Float32Array, edge: Float32Array, push: Float32Array, config: SegmentConfig
) -> Float32Array:
    """phi after the steps of a config, shape (n, h, w), from phi, edge indicator and push of this shape."""
    edge_x, edge_y = _along_x(edge), _along_y(edge)
    phi = phi.copy()
    for _ in range(config.steps):
        phi_x, phi_y = _along_x(phi), _along_y(phi)
        slope = np.sqrt(phi_x * phi_x + phi_y * phi_y)
        unit = 1.0 / (slope + np.float32(1e-10))
        normal_x, normal_y = phi_x * unit, phi_y * unit
        curvature = _divergence(normal_x, normal_y)
        pull = config.length_weight * (edge_x * normal_x + edge_y * normal_y + edge * curvature)
        pull += push
        pull *= _dirac(phi, config.dirac_width_px)
        phi += config.time_step * (config.distance_weight * _distance_term(phi, phi_x, phi_y, slope) + pull)
    return phi


def _along_x(stack: Float32Array) -> Float32Array:
    """Central differences along x of (n, h, w); one-sided at the border."""
    out = np.empty_like(stack)
    np.subtract(stack[:, :, 2:], stack[:, :, :-2], out=out[:, :, 1:-1])
    out[:, :, 1:-1] *= np.float32(0.5)
    out[:, :, 0] = stack[:, :, 1] - stack[:, :, 0]
    out[:, :, -1] = stack[:, :, -1] - stack[:, :, -2]
    return out


def _along_y(stack: Float32Array) -> Float32Array:
    """Central differences along y of (n, h, w); one-sided at the border."""
    out = np.empty_like(stack)
    np.subtract(stack[:, 2:], stack[:, :-2], out=out[:, 1:-1])
    out[:, 1:-1] *= np.float32(0.5)
    out[:, 0] = stack[:, 1] - stack[:, 0]
    out[:, -1] = stack[:, -1] - stack[:, -2]
    return out


def _divergence(vx: Float32Array, vy: Float32Array) -> Float32Array:
    out = _along_x(vx)
    out += _along_y(vy)
    return out


def _laplacian(phi: Float32Array) -> Float32Array:
    """Five-point Laplacian with zero slope across the border."""
    out = np.float32(-4) * phi
    out[:, 1:] += phi[:, :-1]
    out[:, :-1] += phi[:, 1:]
    out[:, :, 1:] += phi[:, :, :-1]
    out[:, :, :-1] += phi[:, :, 1:]
    out[:, 0] += phi[:, 0]
    out[:, -1] += phi[:, -1]
    out[:, :, 0] += phi[:, :, 0]
    out[:, :, -1] += phi[:, :, -1]
    return out


def _distance_term(
    phi: Float32Array, phi_x: Float32Array, phi_y: Float32Array, slope: Float32Array
) -> Float32Array:
    """div(d_p(|grad phi|) grad phi) for the double-well potential p_2 (eqs. 16 and 17 of Li et al.).

    d_p(s) = sin(2 pi s) / (2 pi s) for s <= 1, and 1 - 1 / s above. Written as the Laplacian plus the
    divergence of (d_p - 1) grad phi, which damps the checkerboard that central differences do not see.
    """
    two_pi = np.float32(2 * np.pi)
    safe = np.maximum(slope, np.float32(1e-6))
    rate = np.where(slope <= 1, np.sin(two_pi * safe) / (two_pi * safe), 1 - 1 / safe) - np.float32(1)
    return _laplacian(phi) + _divergence(rate * phi_x, rate * phi_y)


def _dirac(phi: Float32Array, width_px: float) -> Float32Array:
    """(1 + cos(pi phi / eps)) / (2 eps) within eps of the zero level, else 0."""
    wave = np.cos(phi * np.float32(np.pi / width_px))
    return np.where(np.abs(phi) <= width_px, (1 + wave) * np.float32(0.5 / width_px), np.float32(0))
