"""Our own paper, "The period of a released chain": its numbers, figures and pages."""
