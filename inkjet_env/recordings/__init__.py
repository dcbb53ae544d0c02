"""Recordings of a head: reading, checking, writing."""

from inkjet_env.recordings.campaign import Campaign
from inkjet_env.recordings.checks import Finding, check_campaign
from inkjet_env.recordings.reading import read_campaign
from inkjet_env.recordings.recording import CampaignError, Recording
from inkjet_env.recordings.writing import write_campaign

__all__ = [
    "Campaign",
    "CampaignError",
    "Finding",
    "Recording",
    "check_campaign",
    "read_campaign",
    "write_campaign",
]
