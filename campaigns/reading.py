"""A store's plan, trials and freeze frames, each checked before anything is made of them.

Belongs here: what every report begins with. Never: a figure.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from pydantic import ValidationError

from campaigns.errors import CampaignError
from campaigns.kinds import StoredPlan
from campaigns.narx_plan import NarxGrid
from campaigns.offline import SOE_MS
from campaigns.offline_plan import OfflineCampaign, t_key
from campaigns.plan import KINDS
from campaigns.rivals import NAMES
from campaigns.road_plan import RoadPlan
from campaigns.schema import check_campaign, check_frame, check_row
from campaigns.store import Document, Row, Store


def plan_of(store: Store) -> StoredPlan:
    """The plan a store was made for. Raises CampaignError for one that keeps no trials."""
    with _damaged(store):
        check_campaign(store.campaign)
    table, order = store.campaign["plan"], store.campaign["conditions"]
    try:
        # canonical JSON has its keys in order of the alphabet, the tables have the plan's
        if "faults" in table:
            table = {**table, "faults": {name: table["faults"][name] for name in order}}
        plan = KINDS[table["kind"]](**table)
    except (KeyError, TypeError, ValidationError):
        plan = None
    if not isinstance(plan, RoadPlan | OfflineCampaign | NarxGrid):
        raise CampaignError(f"{store.path}: holds no campaign that can be reported on")
    return plan


def rows_of(store: Store, plan: StoredPlan) -> list[Row]:
    """The finished trials of a store of that plan, ordered by id."""
    kinds = (plan.kind, "offline_soe") if isinstance(plan, OfflineCampaign) else (plan.kind,)
    rows = list(store.rows())
    with _damaged(store):
        for row in rows:
            check_row(row, kinds)
            if isinstance(plan, OfflineCampaign):
                _check_cells(row, plan)
    return rows


def frame_of(store: Store, id: str) -> Document | None:
    """The freeze frame of a trial, None where it has none."""
    frame = store.frame(id)
    if frame is not None:
        with _damaged(store):
            check_frame(frame, id)
    return frame


def _check_cells(row: Row, plan: OfflineCampaign) -> None:
    """Every T, L and n of the plan, and nothing that it knows no name of."""
    levels = {t_key(t) for t in plan.T_percent}
    if row.trial["kind"] == "offline_soe":
        curves = row.result["curves"]
        windows = {str(ms) for ms in (*plan.L_ms, SOE_MS)}
        fits = set(curves) == windows and all(set(curve["beyond"]) == levels for curve in curves.values())
    else:
        tables = row.result["first_alarm_ns"]
        fits = row.trial["condition"] in plan.faults and set(row.result.get("others", {})) <= set(NAMES)
        fits &= (tables is None) == (row.result["t_active_ns"] is None)
        fits &= tables is None or (
            set(tables) == levels
            and all(
                [len(line) for line in table] == [len(plan.n)] * len(plan.L_ms) for table in tables.values()
            )
        )
    if not fits:
        raise CampaignError(f"result of trial {row.id}: is not of the plan's faults, T, L and n")


@contextmanager
def _damaged(store: Store) -> Iterator[None]:
    try:
        yield
    except CampaignError as problem:
        raise CampaignError(f"{store.path}: is damaged: {problem}") from None
