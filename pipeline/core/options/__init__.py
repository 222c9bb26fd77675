"""The types of the options, section by section. Values, units and reasons stand in the option
files; a key that is not here is refused."""
