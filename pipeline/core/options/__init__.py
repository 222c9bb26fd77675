"""Types of the options; values and reasons are in the option files, unknown keys are errors."""
