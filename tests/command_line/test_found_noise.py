"""What was found of the noise is in the configuration's file, where it changed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import yaml

from gpvo.commands.found_noise import CHANGE, NoiseHistory
from gpvo.config import Configuration, configuration_text
from gpvo.config.stages import NoiseConfig
from gpvo.observer import Step


def step(t: float, scale: float, background: float, noise: object = None) -> Step:
    """Make what an observer sees of a cluster; Q_c is `scale` times that at the start."""
    qc = [scale * value for value in NoiseConfig().acceleration_psd]
    found = NoiseConfig.model_validate({"acceleration_psd": qc}) if noise is None else noise
    report = SimpleNamespace(stop=t, noise_rate=background)
    return cast(Step, SimpleNamespace(report=report, estimator=SimpleNamespace(noise=found)))


def test_a_line_a_change() -> None:
    history = NoiseHistory()
    scales = [1.0, 1.0 + 0.9 * CHANGE, 1.0 + 1.1 * CHANGE, 1.0 + 1.1 * CHANGE, 0.5]
    for number, scale in enumerate(scales):
        history(step(0.1 * number, scale, 0.0))
    history(step(0.5, 0.5, 2.0))
    assert [round(one.t, 3) for one in history.changes] == [0.0, 0.2, 0.4, 0.5]
    assert history.changes[-1].background == 2.0


def test_the_file_stays_the_configuration() -> None:
    history, configuration = NoiseHistory(), Configuration()
    history(step(0.1, 3.0, 1.0))
    text = configuration_text(configuration) + history.text
    assert Configuration.model_validate(yaml.safe_load(text)) == configuration
    assert text.splitlines()[-1].startswith("# 0.100  [")


def test_an_estimator_that_learns_nothing_has_no_lines() -> None:
    history = NoiseHistory()
    history(step(0.1, 1.0, 0.0, noise="none"))
    assert history.text == ""
