"""Many logs, one model: what they share, how they differ, and which doesn't belong."""

from __future__ import annotations

from kinid.campaign.campaign import Campaign

__all__ = ["Campaign"]
