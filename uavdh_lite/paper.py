"""The paper's own results, to compare with (Bayerlein et al., Globecom 2020)."""

RESULTS = {
    "manhattan": {
        "has_landed": 0.995,
        "collection_ratio": 0.948,
        "collection_ratio_and_landed": 0.946,
    },
    "open_field": {
        "has_landed": 0.999,
        "collection_ratio": 0.900,
        "collection_ratio_and_landed": 0.899,
    },
}
"""The mean of each metric over 1000 random missions, by map; one agent was trained for each map,
and the maps themselves were never published."""
