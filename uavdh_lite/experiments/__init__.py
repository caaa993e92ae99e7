"""Runs in their folders, ablations, comparisons."""
