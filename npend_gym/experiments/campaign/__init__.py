"""Campaigns: the release experiment swept at scale, on one machine or many, with nothing lost.

`CampaignPlan` says what to release, `Campaign` carries it out in a folder, which `load` reads; see
`docs/campaigns.md` for what lies in the folder and `npend campaign` for the command.
"""

from __future__ import annotations

from npend_gym.experiments.campaign.driver import BusyError, Campaign, DiskError
from npend_gym.experiments.campaign.engine import BACKENDS, WorkersLostError
from npend_gym.experiments.campaign.folder import FolderStatus
from npend_gym.experiments.campaign.journal import Record
from npend_gym.experiments.campaign.plan import CampaignPlan, Task

__all__ = [
    "BACKENDS",
    "BusyError",
    "Campaign",
    "CampaignPlan",
    "DiskError",
    "FolderStatus",
    "Record",
    "Task",
    "WorkersLostError",
]
