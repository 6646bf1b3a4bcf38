"""Many sites on many machines: Ray places, starts and ends the services; zenoh carries their data.

`controller` decides and knows neither Ray nor zenoh. `ray_plane` and `epoch_watch` are its hands and its eyes.
"""
