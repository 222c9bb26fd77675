"""One root for everything the pipeline refuses, each error carrying its evidence."""


class PipelineError(Exception):
    """Refusal with its evidence by keyword: file, line, take, step, key …"""

    def __init__(self, message: str, **evidence: object) -> None:
        self.message = message
        self.evidence = {name: value for name, value in evidence.items() if value is not None}
        where = ", ".join(f"{name} {value}" for name, value in self.evidence.items())
        super().__init__(f"{message} [{where}]" if where else message)


class ConfigError(PipelineError):
    """An option, key or type of the configuration that does not exist or does not fit."""


class RecordingError(PipelineError):
    """A raw file that is missing, truncated, malformed or contradicts itself."""


class ContractError(PipelineError):
    """A table between stages that breaks its contract: column, type, range or missing table."""


class SingularJacobianError(PipelineError):
    """The Jacobian cannot be inverted at a pose where the paper's models need its inverse."""


class ModelDomainError(PipelineError):
    """A model parameter outside the set on which the model exists (sigma_B, u, a covariance)."""


class SolverError(PipelineError):
    """An optimisation that did not end at an optimum; no number may be taken from it."""


class DegenerateFilterError(PipelineError):
    """A particle filter all of whose weights vanished."""


class ComputeError(PipelineError):
    """Workers that cannot be reached, are lost, or might give other bytes than this machine."""
