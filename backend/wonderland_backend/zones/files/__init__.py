"""Files of zones: read, checked, and brought to one form, the features of ED-318. No I/O."""
