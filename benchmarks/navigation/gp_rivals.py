"""scikit-learn and GPyTorch on the data of `gp.py`: run by it with the Python of `.venv-bench`, one line of JSON out.

Usage: python gp_rivals.py DATA.npz

DATA.npz: locations (n, 2), depths (n,), queries (P, 2), new (m, 2), new_depths (m,), signal_std, length, noise_std,
mean.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np

#: Locations requested in one call: the speed of both libraries depends on it, so the best is searched for, too.
CHUNKS = (256, 2048)


def seconds(function: Any) -> float:
    """Processor time of a call (s); on an idle core it equals wall-clock time."""
    begin = time.process_time()
    function()
    return time.process_time() - begin


def scikit_learn(data: Any) -> dict[str, Any]:
    """Map, at once and in chunks: the faster counts."""
    import sklearn
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern

    kernel = ConstantKernel(float(data["signal_std"]) ** 2) * Matern(float(data["length"]), nu=2.5)
    model = GaussianProcessRegressor(kernel, alpha=float(data["noise_std"]) ** 2, optimizer=None)
    model.fit(data["locations"], data["depths"] - float(data["mean"]))
    queries = data["queries"]
    parts: list[Any] = []

    def predict(chunk: int) -> None:
        parts[:] = [model.predict(queries[i : i + chunk], return_std=True) for i in range(0, len(queries), chunk)]

    by_chunk = {str(chunk): seconds(lambda chunk=chunk: predict(chunk)) for chunk in (*CHUNKS, len(queries))}
    return {
        "version": sklearn.__version__,
        "by_chunk": by_chunk,
        "mean_sum": float(sum(m.sum() for m, _ in parts) + len(queries) * float(data["mean"])),
        "std_sum": float(sum(s.sum() for _, s in parts)),
    }


def gpytorch(data: Any) -> dict[str, Any]:
    """Exact map, and appending one datum."""
    import gpytorch
    import torch

    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)

    class Exact(gpytorch.models.ExactGP):  # type: ignore[misc]  # the library has no types
        def __init__(self, x: Any, y: Any, likelihood: Any) -> None:
            super().__init__(x, y, likelihood)
            self.mean_module = gpytorch.means.ConstantMean()
            self.covar_module = gpytorch.kernels.ScaleKernel(gpytorch.kernels.MaternKernel(nu=2.5))

        def forward(self, x: Any) -> Any:
            return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    x, y, queries = (torch.tensor(data[name]) for name in ("locations", "depths", "queries"))

    def model() -> Any:
        likelihood = gpytorch.likelihoods.GaussianLikelihood()
        made = Exact(x, y, likelihood)
        likelihood.noise = float(data["noise_std"]) ** 2
        made.mean_module.constant.data.fill_(float(data["mean"]))
        made.covar_module.outputscale = float(data["signal_std"]) ** 2
        made.covar_module.base_kernel.lengthscale = float(data["length"])
        made.eval()
        likelihood.eval()
        return made

    # Cholesky throughout: from 800 data on GPyTorch would use conjugate gradients, which are not exact.
    with torch.no_grad(), gpytorch.settings.fast_pred_var(False), gpytorch.settings.max_cholesky_size(100_000):
        made = model()
        made(queries[:10])  # makes and keeps what depends on the data alone, as a running node would have
        parts: list[Any] = []

        def predict(chunk: int, made: Any = made) -> None:
            predictions = (made(part) for part in queries.split(chunk))
            parts[:] = [(p.mean, p.variance.clamp_min(0).sqrt()) for p in predictions]

        result: dict[str, Any] = {
            "version": f"{gpytorch.__version__}, torch {torch.__version__}",
            "by_chunk": {str(chunk): seconds(lambda chunk=chunk: predict(chunk)) for chunk in CHUNKS},
            "mean_sum": float(sum(m.sum() for m, _ in parts)),
            "std_sum": float(sum(s.sum() for _, s in parts)),
        }
    with torch.no_grad(), gpytorch.settings.fast_pred_var(), gpytorch.settings.max_cholesky_size(100_000):
        made = model()
        made(queries[:10])

        def append(made: Any = made) -> None:
            for position, depth in zip(data["new"], data["new_depths"], strict=True):
                made = made.get_fantasy_model(torch.tensor(position[None]), torch.tensor([depth]))

        result["append_s"] = seconds(append) / len(data["new"])
    return result


def main() -> None:
    """Measures each library that is installed."""
    data = dict(np.load(sys.argv[1]))
    results: dict[str, Any] = {}
    for name, measure in (("scikit-learn", scikit_learn), ("GPyTorch", gpytorch)):
        try:
            results[name] = measure(data)
        except ImportError as error:
            results[name] = {"missing": str(error)}
    print(json.dumps(results))


if __name__ == "__main__":
    main()
