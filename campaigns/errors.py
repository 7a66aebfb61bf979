"""Errors of the campaigns' side."""

from bench.errors import BenchError


class CampaignError(BenchError):
    """A campaign file does not describe a campaign."""

    side = "campaign"
