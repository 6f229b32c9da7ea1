"""A domain of your own: learn signals of 64 values from windows of 32 that start anywhere.
unproject check examples/signals.py:Window
unproject train examples/signals.py:signals --minutes 1 --out runs/signals
"""

import torch

import unproject as up


class Window(up.Projection):
    example_shape = (64,)

    def forward(self, x, *, start):
        return x.gather(1, start.long()[:, None] + torch.arange(32).to(x.device))[:, None]


class Signals(up.Domain):
    def preview(self, x):
        return up.export.silhouette_sheet(x[:, None, None].expand(-1, -1, 8, -1), columns=2)

    def scores(self, x, reference, seed=0, turns=None):
        off = torch.fft.rfft(x).abs().mean(0) - torch.fft.rfft(reference).abs().mean(0)
        return {"spectrum": up.metrics.Score(off.norm().item(), "distance of mean spectra", len(x), seed)}


class Waves(up.Generator):
    def __init__(self):
        super().__init__(code_size=8)
        self.layers = torch.nn.Sequential(torch.nn.Linear(8, 64), torch.nn.Sigmoid())

    def forward(self, code):
        return self.layers(code)


def signals(*, seed: int = 0) -> up.Recipe:
    waves = torch.sin(torch.arange(64) / torch.linspace(2, 5, 1000)[:, None]) / 2 + 0.5
    window = up.Observation("window", Window(), up.Uniform("start", 0, 33))
    return up.Recipe(Waves, [up.Panel([window], up.data.observe(waves, [window]))], Signals(), steps=2000, seed=seed)
