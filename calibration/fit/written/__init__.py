"""The model of the machine that a fit or a diagnosis writes: in the datum, with its uncertainty."""
