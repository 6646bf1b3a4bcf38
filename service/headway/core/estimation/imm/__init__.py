"""The default model: an interacting-multiple-model filter over sensor faults."""
