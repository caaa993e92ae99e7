"""The questions of the notebooks' quizzes, by name: `Quiz("half_the_time")`."""

from uavdh_lite.course.quiz import Choice, Question

QUESTIONS = {
    "half_the_time": Question(
        "The same three devices, but half of the flying time. What will the agent do?",
        (
            Choice(
                "Fly the same way and run out of time",
                "The remaining time is one of its inputs, and running out of it was the most "
                "expensive thing in its training.",
            ),
            Choice(
                "Leave some of the data and land in time",
                "It was trained on flying times from 35 to 70 and has to weigh data against the "
                "way home in every step.",
                right=True,
            ),
            Choice(
                "Fly the same way, only faster",
                "Every action takes one unit of time and moves one cell at most.",
            ),
        ),
    ),
    "behind_a_corner": Question(
        "A device 30 m away in sight, or one 10 m away behind a building: which link is better? "
        "(Distances on the ground; exponents 2.27 and 3.64; the UAV flies 10 m high.)",
        (
            Choice(
                "The near one: distance decides",
                "10 m on the ground are 14 m in the air: 36.4 · log10(14.1) = 42 dB lost. At 30 m, "
                "31.6 m in the air, 22.7 · log10(31.6) = 34 dB.",
            ),
            Choice(
                "The one in sight",
                "It loses 34 dB, the near one behind the building 42 dB.",
                right=True,
            ),
            Choice(
                "Both alike",
                "The losses are 34 dB in sight and 42 dB behind the building: a factor of six.",
            ),
        ),
    ),
    "luck_on_average": Question(
        "Fading adds a random number of decibels with mean 0. What does it do to the mean rate at "
        "30 m, where the SNR is low?",
        (
            Choice(
                "Nothing: the mean of the fading is 0",
                "The rate is no straight line in decibels: a gain and a loss of 3 dB do not "
                "cancel.",
            ),
            Choice(
                "It lowers the rate",
                "That would be so if the rate bent downwards in decibels. It bends upwards, most "
                "at 0 dB.",
            ),
            Choice(
                "It raises the rate a little",
                "In decibels the rate bends upwards, most at 0 dB, so that luck gains more than "
                "bad luck loses.",
                right=True,
            ),
        ),
    ),
    "touching_a_corner": Question(
        "A ray touches the corner of one building, and passes it. Is the link blocked?",
        (
            Choice(
                "Yes",
                "Touching is not crossing: the segment must pass through the open interior of a "
                "building cell.",
            ),
            Choice(
                "No",
                "It has no point inside. Between two diagonal buildings, through their common "
                "corner, it would be blocked.",
                right=True,
            ),
            Choice(
                "It depends on the direction",
                "It does for Bresenham's lines. The exact test gives the same answer both ways.",
            ),
        ),
    ),
    "both_ways": Question(
        "If the device sees the UAV, does the UAV see the device, with Bresenham's lines?",
        (
            Choice(
                "Always: light goes both ways",
                "Light does, and so does the exact test. Bresenham rounds to whole cells, and "
                "rounds "
                "differently from the other end.",
            ),
            Choice(
                "Not always: the rounding depends on where the line begins",
                "For some pairs the two lines pass through different cells.",
                right=True,
            ),
            Choice(
                "Never, if there is a building nearby",
                "Most lines pass through the same cells both ways.",
            ),
        ),
    ),
    "off_the_grid": Question(
        "The UAV is in the top row and chooses north. What happens?",
        (
            Choice(
                "The episode ends",
                "Only a landing, or the end of the flying time, ends an episode.",
            ),
            Choice(
                "It comes out at the bottom",
                "The grid has borders; it is not a torus.",
            ),
            Choice(
                "It hovers, for one unit of time, and pays a penalty",
                "The safety controller replaces the move by hovering: −1 for it and −0.2 for the "
                "step.",
                right=True,
            ),
        ),
    ),
    "the_last_step": Question(
        "The UAV stands still above a device with data left and one unit of flying time. It "
        "hovers. "
        "How much is uploaded in this step?",
        (
            Choice(
                "As much as in any other step there",
                "In the step that ends the episode nothing is uploaded, and this step ends it: the "
                "time is over.",
            ),
            Choice(
                "Nothing",
                "The step ends the episode, by a crash, and such a step uploads nothing.",
                right=True,
            ),
        ),
    ),
    "frame_size": Question(
        "A city of 16×16 cells, the UAV always in the middle, the whole city always in the frame. "
        "How many cells a side must the frame have?",
        (
            Choice("16", "With the UAV in a corner, three quarters of the city would be cut off."),
            Choice(
                "32",
                "There is one middle cell, so the side must be odd: 15 cells on either side, "
                "and it.",
            ),
            Choice(
                "31",
                "From one corner the other is 15 cells away: 15 + 1 + 15.",
                right=True,
            ),
        ),
    ),
    "linear_model": Question(
        "A linear model sees the map without centring, and the UAV's position. Can it tell "
        "whether a "
        "device is near the UAV?",
        (
            Choice(
                "Yes: both positions are in its input",
                "Both are there, but nearness is a property of the pair, and a sum of one "
                "weight for "
                "each place has no term for pairs.",
            ),
            Choice(
                "Hardly better than guessing",
                "It adds a number for the device's place to one for the UAV's. Nearness is in "
                "neither of them alone.",
                right=True,
            ),
            Choice(
                "With enough examples",
                "No number of examples adds the terms for pairs that the model does not have.",
            ),
        ),
    ),
    "whose_maximum": Question(
        "All actions are worth 0, but the network's estimates have random errors. What is the "
        "largest estimate, on average?",
        (
            Choice(
                "0: the errors cancel",
                "Those of one action do. The maximum picks the action whose error happens to be "
                "largest.",
            ),
            Choice(
                "Above 0",
                "The maximum picks lucky errors. This is the bias that the double estimator "
                "removes.",
                right=True,
            ),
            Choice(
                "Below 0",
                "That would be the smallest estimate.",
            ),
        ),
    ),
    "cold_policy": Question(
        "What does the softmax policy do when its temperature falls towards 0?",
        (
            Choice(
                "It takes all actions equally often",
                "That is what it does when the temperature is very high.",
            ),
            Choice(
                "It always takes the action with the highest Q-value",
                "The ratio of two probabilities is exp(ΔQ / β), which grows without bound.",
                right=True,
            ),
            Choice(
                "It takes the worst action",
                "The sign of ΔQ / β stays; only a negative temperature would do that.",
            ),
        ),
    ),
    "huge_penalty": Question(
        "From the first step, a crash costs 150, and little exploration. What does the agent learn "
        "first?",
        (
            Choice(
                "To collect as much as it can, carefully",
                "To collect it must fly far, and while it cannot find home that ends in a crash.",
            ),
            Choice(
                "To land at once",
                "A landing in the first steps is the one thing that it can already do and that "
                "avoids "
                "the 150. Then it never sees that flying pays.",
                right=True,
            ),
            Choice(
                "Nothing: the values grow without bound",
                "They are large at first, but bounded by the discounted rewards.",
            ),
        ),
    ),
    "three_seeds": Question(
        "Two methods, three seeds each; every run of one is better than every run of the other. "
        "How "
        "likely is that order if the methods are equally good?",
        (
            Choice(
                "Below 1 %", "There are only 20 ways to pick three of six places, and two count."
            ),
            Choice(
                "About 5 %", "That is one of 20, for one direction. Either could have been first."
            ),
            Choice("10 %", "Two of the 20 ways to pick three of six places.", right=True),
        ),
    ),
    "all_landed": Question(
        "1000 of 1000 missions landed. What do you know about the share of all missions that do?",
        (
            Choice(
                "It is 100 %",
                "An event of one in 5000 is easily missed in 1000 missions.",
            ),
            Choice(
                "Nothing, since there is no spread",
                "If one in 100 failed, 1000 landings in a row would have a chance of 1 in 23,000.",
            ),
            Choice(
                "With 95 % confidence it is above about 99.6 or 99.7 %",
                "Below that, a thousand landings in a row would be a rare coincidence.",
                right=True,
            ),
        ),
    ),
    "one_quarter": Question(
        "Two devices. One of them now holds a quarter of what it held, everything else is the "
        "same. "
        "What does the agent do?",
        (
            Choice(
                "The same flight",
                "The data left is one of its maps: a smaller reward for the same way.",
            ),
            Choice(
                "It may shorten or skip the way to it",
                "The way costs time and reward, and what it brings is less.",
                right=True,
            ),
            Choice(
                "It must be trained anew",
                "The amounts of data are drawn at random for every training episode.",
            ),
        ),
    ),
}
