"""The paper's own results, to compare with (Bayerlein et al., Globecom 2020)."""

RESULTS = {
    "manhattan": {"landed": 0.995, "collected": 0.948, "collected_and_landed": 0.946},
    "open_field": {"landed": 0.999, "collected": 0.900, "collected_and_landed": 0.899},
}
"""The mean of each metric over 1000 random missions, by map; one agent was trained for each map,
and the maps were never published as files."""
