"""Dispersion: each channel has a refractive index of its own, so the channels of a path part where it is refracted.

A dispersive model knows with which probability p_c each channel is chosen at a vertex: its share of the path's
throughput. A direction is drawn from the model of one channel c, with its index n_c, so the density is Σ p_c pdf_c. All
channels are then weighed by that density (single-sample multiple importance sampling, Veach and Guibas 1995, "Optimally
combining sampling techniques", balance heuristic; for wavelengths Wilkie et al. 2014, "Hero wavelength spectral
sampling"). Where a direction is possible for one channel only, as behind a smooth surface, the path goes on with that
channel alone: the other channels of its throughput are zero, so that this channel is always chosen from then on.
"""

import warp as wp

from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model
from wrt.kernels.sampling.warps import BELOW_ONE


@wp.func
def shares_of(throughput: wp.vec3) -> wp.vec3:
    """Return each channel's share of the sum of all; a third each if that is 0."""
    total = throughput[0] + throughput[1] + throughput[2]
    if total > 0.0:
        return throughput / total
    return wp.vec3(1.0 / 3.0)


@wp.func
def channel_at(shares: wp.vec3, u: float) -> int:
    """Return the channel that a random number in [0, 1) chooses; never one with a share of 0."""
    if u < shares[0]:
        return 0
    if u < shares[0] + shares[1] or shares[2] == 0.0:
        return 1
    return 2


@wp.func
def component(v: wp.vec3, channel: int) -> float:
    """Return a channel of a colour."""
    return wp.where(channel == 0, v[0], wp.where(channel == 1, v[1], v[2]))


@wp.func
def alone(channel: int, value: float) -> wp.vec3:
    """Return a colour that is 0 in all channels but one."""
    return wp.vec3(
        wp.where(channel == 0, value, 0.0), wp.where(channel == 1, value, 0.0), wp.where(channel == 2, value, 0.0)
    )


def dispersive(model: Model, channels: int, table_stride: int = 0) -> Model:
    """Return a model whose row of the refractive index holds one for each channel.

    Args:
        model: the model for one index, in all of its row `index_slot`.
        channels: the row of the probabilities of the channels, which is one more than the model has.
        table_stride: distance between the tables of two channels; 0 if they share one.
    """
    ior = model.index_slot
    evaluate_one, pdf_one, sample_one = model.evaluate, model.pdf, model.sample

    @wp.func
    def of_channel(bsdf: Bsdf, channel: int) -> Bsdf:
        bsdf.slots[wp.static(ior)] = wp.vec3(component(bsdf.slots[wp.static(ior)], channel))
        if wp.static(table_stride > 0):
            bsdf.table = bsdf.table + channel * wp.static(table_stride)
        return bsdf

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        value = wp.vec3(0.0)
        # A loop with the code once, which Warp does not unroll; it can differentiate it, unlike a `while`.
        count = int(3)
        for channel in range(count):
            if component(bsdf.slots[wp.static(channels)], channel) > 0.0:
                found = evaluate_one(of_channel(bsdf, channel), wo, wi)
                value += alone(channel, component(found, channel))
        return value

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        density = float(0.0)
        channel = int(0)
        while channel < 3:
            share = component(bsdf.slots[wp.static(channels)], channel)
            if share > 0.0:
                density += share * pdf_one(of_channel(bsdf, channel), wo, wi)
            channel += 1
        return density

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        shares = bsdf.slots[wp.static(channels)]
        channel = channel_at(shares, u_lobe)
        before = wp.where(channel == 0, 0.0, wp.where(channel == 1, shares[0], shares[0] + shares[1]))
        share = component(shares, channel)
        u_rest = wp.clamp((u_lobe - before) / share, 0.0, BELOW_ONE)
        s = sample_one(of_channel(bsdf, channel), wo, u, u_rest)
        if s.delta:
            s.weight = alone(channel, component(s.weight, channel) / share)
        if s.pdf > 0.0:
            s.pdf = pdf(bsdf, wo, s.wi)
            s.weight = evaluate(bsdf, wo, s.wi) / s.pdf
        return s

    return model._replace(evaluate=evaluate, pdf=pdf, sample=sample, slots=channels + 1, channels_slot=channels)
