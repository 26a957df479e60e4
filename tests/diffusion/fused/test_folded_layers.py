"""Tests for the layers and waves that folded networks are made of."""

import math

import torch
from torch import nn

from pd_editor.diffusion.fused.folded_layers import (
    Affine,
    Norm,
    PlaneWaves,
    linear_layers,
)


def test_an_affine_map_is_its_linear_layer() -> None:
    layer = nn.Linear(5, 3)
    values = torch.randn(7, 5)
    with torch.no_grad():
        folded = Affine((layer.weight, layer.bias), layer.weight)
        torch.testing.assert_close(folded(values), layer(values))


def test_a_norm_is_its_layer_norm_and_keeps_the_weights_it_was_made_of() -> None:
    norm = nn.LayerNorm(6)
    values = torch.randn(4, 6)
    with torch.no_grad():
        norm.weight.uniform_(0.5, 2.0)
        norm.bias.normal_()
        expected = norm(values)
        folded = Norm(norm)
        norm.weight.zero_()
        torch.testing.assert_close(folded(values), expected)


def test_waves_are_sines_and_cosines_in_the_order_told() -> None:
    wavelengths_m = (1.0, 5.0, 40.0)
    like = torch.zeros((), dtype=torch.float64)
    waves = PlaneWaves(wavelengths_m, like)
    place_m = 30 * torch.randn(9, 2, dtype=torch.float64)
    found = waves(place_m)
    one_by_one = torch.stack(
        [
            function(2 * math.pi * place_m[:, axis] / wavelength)
            for wavelength in wavelengths_m
            for axis in (0, 1)
            for function in (torch.sin, torch.cos)
        ],
        dim=-1,
    )
    torch.testing.assert_close(found, one_by_one[:, waves.order])


def test_waves_fade_to_what_is_expected_under_noise() -> None:
    wavelengths_m, noise_m = (2.0, 9.0), 0.8
    waves = PlaneWaves(wavelengths_m, torch.zeros((), dtype=torch.float64))
    place_m = torch.tensor([[0.3, -4.0]], dtype=torch.float64)
    stream = torch.Generator().manual_seed(5)
    noise = torch.randn(200_000, 2, generator=stream, dtype=torch.float64)
    noisy = waves(place_m + noise_m * noise)
    clean = waves(place_m)
    fading = waves.fading(torch.tensor([noise_m], dtype=torch.float64))
    torch.testing.assert_close(
        noisy.mean(dim=0, keepdim=True), clean * fading, atol=6e-3, rtol=0
    )


def test_the_linear_layers_of_a_chain_come_in_its_order() -> None:
    first, second = nn.Linear(2, 3), nn.Linear(3, 4)
    chain = nn.Sequential(nn.LayerNorm(2), first, nn.ReLU(), second)
    assert linear_layers(chain) == [first, second]
