"""What a campaign can sweep: the release experiment with its analysis, and functions of a seed."""
