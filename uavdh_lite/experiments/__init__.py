"""Runs in their folders, studies, comparisons."""
