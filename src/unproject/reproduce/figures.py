"""The figures of the paper, and what is asked of each."""

from __future__ import annotations

from .figure import NARROW, Arm, Claim, Figure, ahead_of_paper
from .figures_of_materials import MATERIALS

FEW = {"flips": True, "balance": 0.5, "rounds": 12}
"""For some hundred photographs, most of them from one side."""
FEW_LINES = {"shift": 2.0, "gamma": 0.1}
"""For 1,500 of them."""
BIRD_PHOTOGRAPHS = Arm("birds-photographs", "shapes", "birds-photographs", "297 cut-out photographs", FEW)
CHAIR_PHOTOGRAPHS = Arm("chairs-photographs", "shapes", "chairs-photographs", "100 cut-out product photographs", FEW)


GUESS = {"init_views": True}
GUESSED = ("cars",)
GUESSED_BECAUSE = (
    "Predicted views of this project's cars start from a first guess, one mean shape fitted to all silhouettes; all "
    "others start from random ones. That was chosen after both had been scored on these seeds: without it one run on "
    "cars in two never tells views apart; with it chairs are farther from true ones."
)


def predicted(world: str) -> Arm:
    if world in GUESSED:
        return Arm(f"{world}-predicted", "shapes", world, "silhouettes, views predicted from a first guess on", GUESS)
    return Arm(f"{world}-predicted", "shapes", world, "silhouettes, views predicted")


def papers(world: str) -> Arm:
    return Arm(f"{world}-paper", "shapes-paper", world, "silhouettes, views predicted, the paper's recipe")


def shapes_figure(name: str, things: str, real: tuple[Arm, ...], besides: str) -> Figure:
    """Fig. 2, 3 or 4: shapes from silhouettes whose views nobody knows."""
    arms = (
        predicted(things),
        Arm(
            f"{things}-single",
            "shapes",
            things,
            "the same, one discriminator of all views (PrGAN)",
            {"views": "single"},
        ),
        papers(things),
    )
    return Figure(
        name=name,
        title=f"Shapes of {things} from silhouettes",
        claim=f"From silhouettes alone, no view known, a generator learns shapes of {things} that hold from all sides.",
        says="Results of VP-MP-GAN from several viewpoints, trained on silhouettes of photographs only. No numbers.",
        arms=arms,
        real=real,
        caption="Each row is a shape, seen from four sides.",
        claims=(
            Claim(
                "Predicted views give better shapes than one discriminator", arms[0].name, arms[1].name, ("mmd_iou",)
            ),
            Claim(
                "They are harder to tell from true ones, kinds that are missing counted, than one discriminator's",
                arms[0].name,
                arms[1].name,
                ("1nna_iou",),
            ),
            Claim(
                "Shapes are at most one and a half times as far from true ones as other true ones",
                arms[0].name,
                f"truth-{things}",
                ("mmd_iou",),
                factor=1 / 1.5,
            ),
            ahead_of_paper(arms[0].name, arms[2].name, ("mmd_chamfer",)),
        ),
        also={"cov_iou": "more"},
        deviations=(
            f"The embedded family of {things} is procedural, its silhouettes rendered; with `--data`, {besides}.",
            "32³ in the cpu budget; 64³, as the paper has it, in the gpu budget.",
            "This project's arms know that these things are their own mirror images, and that they are solid; the "
            "paper's recipe does not.",
            *((GUESSED_BECAUSE,) if things in GUESSED else ()),
            NARROW,
        ),
    )


FIGURES = {
    figure.name: figure
    for figure in (
        shapes_figure(
            "fig2",
            "chairs",
            (
                Arm(
                    "chairs-modelnet", "shapes", "chairs-modelnet", "silhouettes of ModelNet's chairs, views predicted"
                ),
                CHAIR_PHOTOGRAPHS,
            ),
            "silhouettes of ModelNet's chairs and of photographs too",
        ),
        shapes_figure("fig3", "birds", (BIRD_PHOTOGRAPHS,), "silhouettes of photographs too"),
        shapes_figure(
            "fig4",
            "cars",
            (Arm("cars-meshes", "shapes", "cars-meshes", "silhouettes of 17 car meshes", GUESS),),
            "silhouettes of meshes too; no collection of photographs of cars is at hand",
        ),
        Figure(
            "fig5",
            "Training images grouped by predicted view",
            "The views of unannotated silhouettes are found while the generator is learned.",
            "A selection of training images, assigned to views by the predictor. No numbers.",
            arms=tuple(arm for world in ("chairs", "birds", "cars") for arm in (predicted(world), papers(world))),
            real=(BIRD_PHOTOGRAPHS, CHAIR_PHOTOGRAPHS),
            claims=tuple(
                Claim(
                    f"{w.capitalize()}: at least half of what a predictor finds that was trained on the true views",
                    f"{w}-predicted",
                    "",
                    ("view_of_ceiling",),
                    factor=0.5,
                    higher=True,
                )
                for w in ("chairs", "birds", "cars")
            ),
            also={"view_exact": "more", "view_ceiling_exact": "more"},
            deviations=(
                "Rendered silhouettes, whose true views are known and used for the score alone. What is its own "
                "mirror image has the same silhouette from two views, but for two of the sixteen, so 9 of 16 is the "
                "most that can be found.",
                GUESSED_BECAUSE,
            ),
            caption="Each row is a view: training images that were assigned to it, twelve at most.",
            shows="views",
        ),
        *MATERIALS,
        Figure(
            "fig12",
            "Digits from line integrals",
            "Images are learned from line integrals in ten directions, whether the directions are known or not.",
            "Reference, MP-GAN with known directions, VP-MP-GAN whose digits come out rotated; both of high quality.",
            arms=(
                Arm("digits-known", "digits", "digits", "line integrals, directions known", FEW_LINES),
                Arm(
                    "digits-predicted",
                    "digits",
                    "digits",
                    "line integrals, directions predicted",
                    {"views": "predicted", **FEW_LINES},
                ),
                Arm("digits-direct", "digits", "digits", "the images themselves", {"views": "direct", **FEW_LINES}),
                Arm("digits-paper", "digits-paper", "digits", "directions known, the paper's recipe"),
                Arm(
                    "digits-predicted-paper",
                    "digits-paper",
                    "digits",
                    "directions predicted, the paper's recipe",
                    {"views": "predicted", "predictor_steps": 200, "predictor_images": 2048},
                ),
            ),
            real=(
                Arm("mnist-known", "digits", "mnist", "MNIST's, directions known"),
                Arm("mnist-predicted", "digits", "mnist", "MNIST's, directions predicted", {"views": "predicted"}),
                Arm("mnist-direct", "digits", "mnist", "MNIST's images themselves", {"views": "direct"}),
            ),
            claims=(
                Claim(
                    "Known directions: at most 1.25 times the distance of training on images",
                    "digits-known",
                    "digits-direct",
                    ("frechet",),
                    factor=0.8,
                ),
                Claim(
                    "Predicted directions: at most twice the distance of training on images",
                    "digits-predicted",
                    "digits-direct",
                    ("frechet",),
                    factor=0.5,
                ),
                Claim(
                    "MNIST, known directions: at most 1.25 times the distance of training on images",
                    "mnist-known",
                    "mnist-direct",
                    ("frechet",),
                    factor=0.8,
                ),
                Claim(
                    "MNIST, predicted directions: at most twice the distance of training on images",
                    "mnist-predicted",
                    "mnist-direct",
                    ("frechet",),
                    factor=0.5,
                ),
                ahead_of_paper("digits-known", "digits-paper", ("frechet",)),
                Claim(
                    "Predicted directions: nearer than the paper's own recipe in the same budget",
                    "digits-predicted",
                    "digits-predicted-paper",
                    ("frechet",),
                    ours=True,
                ),
            ),
            caption="64 images each.",
            deviations=(
                "Embedded digits are 8² ones, enlarged; with `--data`, MNIST too.",
                "Of embedded digits there are 1,500, one line of each: in all arms but the paper's, what "
                "discriminators see is shifted at random by up to two pixels. How far, and the weight of R1 and R2, "
                "was chosen of five by the known directions' distance at seed 0.",
                "Arms have as many minutes each in the cpu budget: a step on lines takes a third of one on images, so "
                "three times as many fit in.",
                "Predicted directions of the modern recipe are 20 over a whole turn, not 10 over half of one, since an "
                "image may come out turned so far that lines are read from their other end; they start from a first "
                "guess, Gaussian images fitted to the lines.",
                NARROW,
            ),
        ),
    )
}
