"""The errors that bad input causes. Each message names what is wrong and how to put it right."""


class InputError(ValueError):
    """Input that cannot be used: a value, a file, or two things that do not fit together."""


class CityError(InputError):
    """A city that is not valid, or a file that does not hold one."""


class CheckpointError(InputError):
    """A checkpoint file that is damaged, foreign, or does not fit its use."""


class TrainingDiverged(ArithmeticError):
    """The loss or a weight of a training run is not a number any more."""
