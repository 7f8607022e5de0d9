"""Calibrates dielectric-elastomer actuators from recordings, and says which physics the model leaves out.

    import deacal

    fit = deacal.fit_film("my-robot/sym-01")      # a path, or what deacal.read gave, or a list of them
    fit                                           # in a notebook: the report
    fit.parameters["mu_1"].ci95
    deacal.validate("my-robot/circle", fit).says
    deacal.predict("my-robot/circle", fit, "motion").to_pandas()
    deacal.library                                # parameter sets to begin with

Numbers, words and files are those of the program `deacal`. A job that cannot be done raises DeacalError,
an argument that cannot be meant ValueError or TypeError. Ctrl-C ends a call at once.
"""

from ._deacal import (
    Ageing,
    DeacalError,
    Diagnosis,
    Fit,
    Library,
    Parameter,
    ParameterFile,
    ParameterSet,
    Prediction,
    Recording,
    Result,
    Simulated,
    Table,
    Validation,
    __version__,
    ageing,
    diagnose,
    fit_axis,
    fit_coupon,
    fit_film,
    fit_forearm,
    fit_hinge,
    fit_robot,
    fit_sample,
    library,
    predict,
    read,
    simulate,
    validate,
)

__all__ = [
    "Ageing",
    "DeacalError",
    "Diagnosis",
    "Fit",
    "Library",
    "Parameter",
    "ParameterFile",
    "ParameterSet",
    "Prediction",
    "Recording",
    "Result",
    "Simulated",
    "Table",
    "Validation",
    "__version__",
    "ageing",
    "diagnose",
    "fit_axis",
    "fit_coupon",
    "fit_film",
    "fit_forearm",
    "fit_hinge",
    "fit_robot",
    "fit_sample",
    "library",
    "predict",
    "read",
    "simulate",
    "validate",
]
