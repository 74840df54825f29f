"""Many logs, one model: what they share, how they differ, and which doesn't belong."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinid.campaign.campaign import Campaign

__all__ = ["Campaign"]


def __getattr__(name: str) -> Any:
    if name != "Campaign":
        raise AttributeError(f"module 'kinid.campaign' has no attribute '{name}'")
    # whether paths name many logs is asked by every command: that needs none of what fits them
    from kinid.campaign.campaign import Campaign

    return Campaign
