"""Transfer (§6): evolved individuals on robots, each trial paired with its simulation; begins in `run`."""
