"""The way of a batch through all tables: one compiled call before the filter, one after it.

A call from Python costs a few microseconds, more than the work on one record, so one call handles a whole round.
"""
