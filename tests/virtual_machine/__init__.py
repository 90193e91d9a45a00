"""A virtual machine tool and its instruments, written a second time, to examine ncomp with.

It shares nothing with ncomp but the machine files, the conventions (docs/conventions.md, docs/effects.md) and the
measurement file: NumPy and the standard library are all it imports. Data go one way:

    machines/*.toml -> Chain         chain.py      exact homogeneous transforms, finite rotations
    seed -> Curves                   truth.py      smooth error motions of every axis
    seed -> Session                  session.py    what is done when: positions, targets, stations, time, heat, feed
                                     designs.py
    Cause                            machine_causes.py, instrument_causes.py
    Setup -> CSV                     observe.py, sheet.py    poses of the tracker, what it sees, noise
    kind, machine, seed -> Draw      draws.py       a question of the exam
    Draw -> Result                   exam.py, scoring.py     asked of the command, its files judged

**Size of a cause** (`observe.scale_to`): the RMS over all rows that see the tool of the length of the displacement that
it brings to the observed point is f times the standard uncertainty of the mean of one position, the RMS over rows and
the three components, averaged over the repeated visits of the position. f is drawn log-uniformly from 2 to 10. Of a
cause that only a calibration from before shows (squareness, the tracker's ranges and circles), what counts is what the
registration of the stations leaves of its displacement. Single outliers are not scaled so: each is 10 to 50 standard
uncertainties of one observation.
"""
