"""Faults put into the code on purpose: does a test notice each of them?

    make mutations MUTANTS=200 SEED=1

`operators` draws the faults (a sign, a unit, an axis letter ...), `modules` has the modules that decide signs and
positions with the tests of each, `runner` runs these tests with the fault, and `argued` has the faults that change
nothing a user can see, each with its reason.
"""
