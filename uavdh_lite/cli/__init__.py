"""The command line, a module a command: each parses, calls the library and prints.

It stands on Cyclopts, because its errors are exceptions with a message of one line, it takes the
help of an `option(...)` field as it is, and its `--help` needs 0.2 s. tyro starts as fast and knows
defaults of an instance, but prints errors as boxes of several lines; typer has no options that take
any number of values, such as `--strides 3 1`.

The modules import the library inside their functions, so that no `--help` waits for PyTorch.
"""
