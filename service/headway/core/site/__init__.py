"""One site between steps: the state of all its vehicles, and what a step does with it beside the kernels."""
