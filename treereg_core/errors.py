"""The few errors a user can act on. Each carries one sentence: what, where, and what to do."""


class TreeregError(Exception):
    """Base of every error that treereg raises on purpose; its text is one sentence for a person."""


class InputError(TreeregError):
    """A file, folder or survey that cannot be used as it is (exit code 2)."""


class UsageError(TreeregError):
    """A command, expression, option or setting that cannot be understood (exit code 2)."""


class PluginError(TreeregError):
    """A plugin that cannot be loaded or breaks the contract, named with its distribution."""


class NoRegistration(TreeregError):  # noqa: N818 -- an outcome, not a fault
    """A stage found nothing it can stand for; the run ends with the verdict `failed`, not with an error."""


def in_words(error: Exception) -> str:
    """A plugin's own error in one line, for a warning: its kind and what it says."""
    text = " ".join(str(error).split()) or "no message"
    return f"{type(error).__name__}: {text}"
