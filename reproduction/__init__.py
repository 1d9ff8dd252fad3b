"""The paper's Section IV on the virtual rig, whole: what each method of compensation makes of the same readings.

`run` does it all; a file a question beside it. The rig (simulate/) makes the readings and knows the truth; the
methods of compensation (`methods`, `prior_work`) see readings and stated orientations alone.
"""
