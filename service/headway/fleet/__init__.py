"""Many sites on many machines: Ray places, starts and ends the services; zenoh carries their data.

`controller` decides and uses neither Ray nor zenoh. `ray_plane` starts and ends services,
`epoch_watch` shows which run.
"""
