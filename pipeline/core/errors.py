"""Exceptions of the pipeline, all subclasses of PipelineError."""


class PipelineError(Exception):
    """Error with a message and its evidence by keyword: file, line, take, step, key …"""

    def __init__(self, message: str, **evidence: object) -> None:
        self.message = message
        self.evidence = {}
        for name, value in evidence.items():
            if value is not None:
                self.evidence[name] = value
        where = [f"{name} {value}" for name, value in self.evidence.items()]
        text = f"{message} [{', '.join(where)}]" if where else message
        super().__init__(text)


class ConfigError(PipelineError):
    """An option, key or value of the configuration is unknown or wrong."""


class RecordingError(PipelineError):
    """A raw file is missing, truncated, malformed or contradictory."""


class ContractError(PipelineError):
    """A table between stages is missing, or a column breaks its declaration."""


class SingularJacobianError(PipelineError):
    """The Jacobian has no inverse at a pose where the paper's models need one."""


class ModelDomainError(PipelineError):
    """A model has no value for a parameter (sigma_B, u, a covariance) or for these data."""


class SolverError(PipelineError):
    """An optimisation did not converge; its result is not used."""


class DegenerateFilterError(PipelineError):
    """All weights of a particle filter vanished."""


class ComputeError(PipelineError):
    """Workers cannot be reached, are lost, or might compute other bytes than this machine."""
