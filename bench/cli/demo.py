"""`bench demo`: the main job on embedded defaults."""

from __future__ import annotations

from pathlib import Path

from bench.cli.options import Workers


def demo(
    workers: Workers = None,
) -> None:
    """Ride a short road trial, the emulated MCU in every lap, and print its tables beside the thesis's."""
    from tempfile import TemporaryDirectory

    from bench.cli import campaign_run
    from campaigns.plan import load
    from campaigns.road_plan import RoadPlan
    from campaigns.store import Store

    where = campaign_run.executor(workers, None)
    plan = load("demo")
    assert isinstance(plan, RoadPlan)
    ready = campaign_run.prepared("demo", plan, None, "mcu", None, workers)
    with TemporaryDirectory() as folder, Store.open(Path(folder) / "demo.sqlite", ready.campaign) as store:
        campaign_run.carry_out(ready, store, where, False)
        campaign_run.report(store, campaign_run.Outputs())
