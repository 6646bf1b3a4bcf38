"""Physical limits that hold from the first message on, and what each sensor is found to be."""
