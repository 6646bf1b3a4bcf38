"""The messages of other systems as records of BSM v1: J2735 in JSON and UPER, CAM in JSON and UPER."""
