"""Measurements as shops take them, each with effects that its file does not declare: the second exam of diagnoses.

It shares nothing with ncomp, nor with the first exam (tests/virtual_machine): NumPy and the standard library are all it
imports, and the chains of its machines are written down again. Data go one way:

    chain.py            gantry, C-frame and DMU 50: products of 4 x 4 matrices, axis by axis, nothing linearised
    error_motions.py    random error motions of every axis
    tracker.py          a laser tracker: pose, noise by range and angle
    designs.py          order of positions, targets, clock, temperatures, stations -> Run
    causes.py           hidden effects of known kinds; outside_causes.py: hidden effects that no library holds
    question.py         (design, cause, machine, draw, seed) -> Question: the measurement file, and the truth
    scoring.py          a diagnosis (contract 4.3) against the truth
    exam.py             questions put to the command line; a Record each
    summary.py          the table of the records

**Size of a hidden effect**: the RMS of what it adds to the observed points, a rigid motion apart, is 0.7 to 6 times the
RMS of the noise, drawn log-uniformly. It is enlarged within these limits until smooth error motions (Legendre
polynomials of degree 8) and the pose of the tracker leave a non-centrality of 100. Where even the largest size that
occurs in a shop leaves less, or where they imitate all but 15 % of the signal, the effect is drawn again; after 30 draws
the question is not asked, because the design does not show the effect. Outliers are always off by 0.4 mm. Sizes, and
the visible share, are in the record.

**The same draw** of a design and a machine has the same error motions, poses and noise for every cause. So the question
with the cause `none` is the same data with nothing hidden.
"""
