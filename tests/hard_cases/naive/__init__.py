"""Deliberately naive variants, each with one textbook mistake that the hard cases must find."""

from naive.accelerations import DenseSolve, InvertedJacobian, RegularisedMass
from naive.kept import SavedPositions, SinglePrecision, SummedClock, WrappedAngles
from naive.printed import PrintedReport
from naive.steps import EstimateWithoutFloor, ExplicitEuler, FixedSteps
from naive.stops import CubicGuess, FlippedVelocity, ImpulseAtStepEnd

VARIANTS = (
    DenseSolve, RegularisedMass, InvertedJacobian, ExplicitEuler, FixedSteps, EstimateWithoutFloor,
    FlippedVelocity, ImpulseAtStepEnd, CubicGuess, WrappedAngles, SinglePrecision, SummedClock,
    SavedPositions, PrintedReport,
)  # fmt: skip
