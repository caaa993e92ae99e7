"""Wrong answers to the exercises of notebook 0, and what the message must say of each."""


def _sorts_first(collected, initial, landed):
    collected.sort()
    initial.sort()
    return sum(collected) / sum(initial) if landed else 0


def _per_device(collected, initial, landed):
    """Right, but for a device without data: the mean weighted by the devices' data."""
    ratios = [c / i * i for c, i in zip(collected, initial, strict=True)]
    return sum(ratios) / sum(initial) if landed else 0


def _mean_ratio(collected, initial):
    ratios = [c / i for c, i in zip(collected, initial, strict=True)]
    return sum(ratios) / len(ratios)


OUT_AND_BACK = ["east"] * 6 + ["hover"] * 3 + ["west"] * 6

MISTAKES = {
    "flight_score": [
        (lambda c, i, landed: _mean_ratio(c, i) if landed else 0, "devices' own ratios"),
        (lambda c, i, landed: sum(c) / sum(i), "has not landed scores 0"),
        (lambda c, i, landed: _mean_ratio(c, i), "not average the devices' own ratios"),
        (lambda c, i, landed: 100 * sum(c) / sum(i) if landed else 0, "from 0 to 1"),
        (
            lambda c, i, landed: (sum(i) - sum(c)) / sum(i) if landed else 0,
            "the sum of all",
        ),
        (lambda c, i, landed: 0 if landed else sum(c) / sum(i), "UAV that has landed is"),
        (_per_device, "had no data at the start"),
        (_sorts_first, "changes what it is given"),
    ],
    "flown_by_hand": [
        (["south", "up"], "Step 2 is 'up', which is no action"),
        (["South", "land"], "in small letters"),
        ([2, 2, 5], "Give names"),
        ("south", "must be a list"),
        (["east"] + ["south"] * 4, r"intervened at step 4, .*cell \(3, 1\) is no-fly"),
        (["east"] * 4 + ["south"], r"cell \(1, 4\) is no-fly or a tall building"),
        (["north"], "the map ends there"),
        (["east"] * 3 + ["land"], "outside the landing zone"),
        (OUT_AND_BACK, "last action must be `land`"),
        ([*OUT_AND_BACK, "land"], "only 5.* of the data.*5 of 21 units of time are not used"),
        ([*OUT_AND_BACK, *["south"] * 4, *["hover"] * 8], "flying time ran out"),
        ([*OUT_AND_BACK, "land", "south"], "Put `land` last"),
        (
            ["south"] * 4
            + ["hover"] * 2
            + ["north"] * 4
            + ["east"] * 5
            + ["hover"]
            + ["west"] * 4
            + ["land"],
            "only 6.*9.6 of 15 data units",
        ),
    ],
}
