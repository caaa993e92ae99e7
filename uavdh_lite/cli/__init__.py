"""The command line, with a module for each command, which parses, calls the library and prints.

It uses Cyclopts, which raises errors with a message of one line and takes the help of an
`option(...)` field as it is. tyro and typer start as fast, but tyro prints an error as a box of
several lines, and typer has no options that take any number of values, such as `--strides 3 1`.

The modules import the library inside their functions, so that no `--help` waits for PyTorch.
"""
