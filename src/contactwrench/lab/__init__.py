"""The virtual lab: the rig of `simulate` as time passes, behind fake devices that speak the devices' own protocols.

It judges what listens to devices, so it is written from the wire formats alone and sees nothing that listens. `rig` is
the machine, `truth` what a device shows of it, `device` what all devices have in common, then one file a protocol;
`control` takes orders. Every fake also works without the rig, on a `Plain` truth, in anybody's tests. Times are
seconds of `time.monotonic`.
"""
