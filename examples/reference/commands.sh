mtp-bench run stp --env MTP-Merge-v0 --scenes 1 -o runs/merge    # store what an agent answers
mtp-bench score runs/merge                                       # its errors
mtp-bench events runs/merge --sort cost --top 3                  # the costliest moments
mtp-bench view runs/merge --at lost-0 --png frame.png            # a picture of one
